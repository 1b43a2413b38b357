"""Builds the view model from the latest messages and the time; pure.

Fail safe: data that is stale or dated ahead is shown as unknown, never with its last value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from dashboard.live import Snapshot, published_tolerance_s
from dashboard.view import labels
from dashboard.view.dispatcher import dispatcher_status, hardware_status
from dashboard.view.labels import Level, Traffic
from dashboard.view.model import (
    CycleView,
    DashboardView,
    EnergyView,
    HistoryView,
    PreviewView,
    RoadView,
    RsuView,
)
from dashboard.view.vehicles import LIST_FOR_S, vehicle_views
from slipstream import freshness
from slipstream.freshness import age_s as _age_s
from slipstream.messages import (
    CycleReport,
    DispatcherHealth,
    Gate,
    RsuHealth,
    SegmentState,
)

KMH_PER_MPS: Final = 3.6
_MAX_STOPPED_LINES: Final = 5


def build_view(
    snapshot: Snapshot, now_ns: int, *, stale_after_s: float, silent_after_s: float
) -> DashboardView:
    """Build the view model.

    Road data are judged by the limits that the dispatcher publishes and its gates use.

    Args:
        snapshot: the latest messages.
        now_ns: UTC in ns.
        stale_after_s: age above which RSU health and pictures are stale, s; for road data too
            where the dispatcher has published no limit.
        silent_after_s: age above which the dispatcher counts as silent, s.
    """
    limits = _road_limits(snapshot.dispatcher, stale_after_s)
    last = snapshot.cycles[-1] if snapshot.cycles else None
    rsus = _rsus(snapshot.rsus, now_ns, stale_after_s)
    roads = _roads(snapshot, last, now_ns, limits)
    dispatcher, dispatcher_level = dispatcher_status(snapshot, now_ns, silent_after_s)
    headline, headline_level = _headline(roads)
    return DashboardView(
        headline=headline,
        headline_level=headline_level,
        dispatcher=dispatcher,
        dispatcher_level=dispatcher_level,
        roads=roads,
        rsus=rsus,
        previews=_previews(snapshot.previews, rsus, now_ns, stale_after_s),
        vehicles=vehicle_views(snapshot, now_ns),
        cycle=_cycle(last, now_ns) if last else None,
        history=_history(snapshot.cycles),
        problems=(
            *_stopped(snapshot, now_ns, limits),
            *((snapshot.history_problem,) if snapshot.history_problem else ()),
        ),
        device=_device(snapshot, now_ns, silent_after_s),
    )


@dataclass(frozen=True)
class _Limits:
    """Limits within which a SegmentState counts, s."""

    stale_after_s: float
    future_tolerance_s: float


def _road_limits(dispatcher: DispatcherHealth | None, stale_after_s: float) -> _Limits:
    published_s = None if dispatcher is None else dispatcher.stale_after_s
    return _Limits(
        stale_after_s=stale_after_s if published_s is None else published_s,
        future_tolerance_s=published_tolerance_s(dispatcher),
    )


def _device(snapshot: Snapshot, now_ns: int, silent_after_s: float) -> tuple[str, Level] | None:
    health = snapshot.dispatcher
    if health is None or health.hardware is None:
        return None
    if freshness.fault(health.time_ns, now_ns, stale_after_s=silent_after_s) is not None:
        return None
    return hardware_status(health.hardware)


def _headline(roads: Sequence[RoadView]) -> tuple[str, Level]:
    if not roads:
        return "Waiting for the first roadside camera", "warn"
    stable = sum(road.traffic == "stable" for road in roads)
    level: Level = "ok" if stable else "warn"
    if len(roads) == 1:
        return f"Traffic is {roads[0].traffic} on the watched road", level
    return f"Traffic is calm on {stable} of {len(roads)} watched roads", level


def _roads(
    snapshot: Snapshot, last: CycleReport | None, now_ns: int, limits: _Limits
) -> tuple[RoadView, ...]:
    gates = {gate.segment: gate for gate in last.gates} if last else {}
    watching = {
        segment: health.rsu
        for health in snapshot.rsus.values()
        if _age_s(health.time_ns, now_ns) < LIST_FOR_S
        for segment in health.segments
    }
    states: dict[str, list[SegmentState]] = {}
    for (segment, _), state in sorted(snapshot.states.items()):
        if _age_s(state.time_ns, now_ns) < LIST_FOR_S:
            states.setdefault(segment, []).append(state)
    return tuple(
        _road(
            segment,
            watching.get(segment, ""),
            states.get(segment, []),
            gates.get(segment),
            last.cycle if last else None,
            now_ns,
            limits,
        )
        for segment in sorted({*watching, *states, *gates})
    )


def _road(
    segment: str,
    watched_by: str,
    states: Sequence[SegmentState],
    gate: Gate | None,
    cycle: int | None,
    now_ns: int,
    limits: _Limits,
) -> RoadView:
    decisive = freshness.decisive(
        states,
        now_ns,
        stale_after_s=limits.stale_after_s,
        future_tolerance_s=limits.future_tolerance_s,
    )
    state = None if decisive is None else decisive.state
    traffic: Traffic = "unknown"
    reason = labels.reason("missing")
    speed = cv = variance = None
    if decisive is not None and decisive.fault is not None:
        reason = labels.reason(decisive.fault)
    elif state is not None:
        traffic = labels.traffic(state.y_e)
        reason = labels.reason(state.reason)
    if state is not None and traffic != "unknown" and state.features is not None:
        mean_mps = state.features.mean_speed_mps.value
        speed = mean_mps * KMH_PER_MPS
        cv = state.features.speed_std_mps.value / mean_mps if mean_mps > 0 else None
        variance = state.features.acceleration_variance_m2ps4.value
    return RoadView(
        segment=segment,
        rsu=state.rsu if state is not None else watched_by,
        traffic=traffic,
        reason=reason,
        speed_kmh=speed,
        cv=cv,
        acceleration_variance=variance,
        age_s=None if decisive is None else decisive.age_s,
        gate_cycle=cycle if gate else None,
        gate_open=gate is not None and gate.open,
        gate_reason="" if gate is None or gate.open else labels.gate_reason(gate.y_e, gate.reason),
    )


def _stopped(snapshot: Snapshot, now_ns: int, limits: _Limits) -> list[str]:
    """A line for each segment on which vehicles stand as in no queue, the longest first."""
    lines = []
    for _, stopped in sorted(snapshot.stopped.items()):
        fault = freshness.fault(
            stopped.time_ns,
            now_ns,
            stale_after_s=limits.stale_after_s,
            future_tolerance_s=limits.future_tolerance_s,
        )
        unusual = stopped.unusual
        if fault is not None or not unusual:
            continue
        first, more = unusual[0], len(unusual) - 1
        lines.append(
            (
                first.since_ns,
                f"A vehicle stands on {stopped.segment}, lane {first.lane + 1} from the right, "
                f"{first.along_m:.0f} m along, for {_age_s(first.since_ns, now_ns):.0f} s"
                + (f", and {more} more" if more else "")
                + f"; traffic is {labels.traffic(stopped.y_e)}",
            )
        )
    told = [line for _, line in sorted(lines)]
    more = len(told) - _MAX_STOPPED_LINES
    return told[:_MAX_STOPPED_LINES] + (
        [f"Vehicles stand on {more} more roads"] if more > 0 else []
    )


_STATUS: Final[dict[str, tuple[str, Level]]] = {
    "ok": ("ok", "ok"),
    "no_signal": ("no picture", "bad"),
    "ended": ("clip ended", "warn"),
}


def _rsus(
    healths: Mapping[str, RsuHealth], now_ns: int, stale_after_s: float
) -> tuple[RsuView, ...]:
    views = []
    for name, health in sorted(healths.items()):
        age_s = _age_s(health.time_ns, now_ns)
        if age_s > LIST_FOR_S:
            continue
        status, level = _STATUS[health.status]
        if health.fault is not None:
            status, level = labels.camera_fault(health.fault), "bad"
        fault = freshness.fault(health.time_ns, now_ns, stale_after_s=stale_after_s)
        fresh = fault is None
        if not fresh:
            status, level = ("silent" if fault == "stale" else "clock ahead"), "bad"
        seen = health.frames + health.frames_skipped
        views.append(
            RsuView(
                rsu=name,
                status=status,
                level=level,
                fps=health.fps if fresh else None,
                latency_ms_p50=health.latency_ms_p50 if fresh else None,
                latency_ms_p95=health.latency_ms_p95 if fresh else None,
                frames_skipped=health.frames_skipped,
                skipped_share=health.frames_skipped / seen if seen else 0.0,
                age_s=age_s,
                segments=health.segments,
                vehicles_in_view=health.vehicles_in_view,
            )
        )
    return tuple(views)


def _previews(
    previews: Mapping[str, tuple[bytes, int]],
    rsus: Sequence[RsuView],
    now_ns: int,
    stale_after_s: float,
) -> tuple[PreviewView, ...]:
    levels = {rsu.rsu: rsu.level for rsu in rsus}
    return tuple(
        PreviewView(
            rsu=rsu,
            jpeg=jpeg,
            age_s=_age_s(arrived_ns, now_ns),
            stale=freshness.fault(arrived_ns, now_ns, stale_after_s=stale_after_s) is not None,
            level=levels.get(rsu, "bad"),
        )
        for rsu, (jpeg, arrived_ns) in sorted(previews.items())
    )


_CYCLE_STATUS: Final[dict[str, tuple[str, Level]]] = {
    "ok": ("ok", "ok"),
    "baseline": ("baseline plan used", "warn"),
    "failed": ("failed", "bad"),
}


def _cycle(report: CycleReport, now_ns: int) -> CycleView:
    status, level = _CYCLE_STATUS[report.status]
    chosen = next((run for run in report.solvers if run.solver == report.solver), None)
    energy = None
    if report.energy is not None:
        e = report.energy
        saved = e.baseline_kwh - e.cooperative_kwh
        energy = EnergyView(
            baseline=e.baseline,
            baseline_kwh=e.baseline_kwh,
            cooperative_kwh=e.cooperative_kwh,
            saved_kwh=saved,
            saved_share=saved / e.baseline_kwh if e.baseline_kwh else 0.0,
            saved_distance_kwh=e.saved_distance_kwh,
            saved_drag_kwh=e.saved_drag_kwh,
            saved_acceleration_kwh=e.saved_acceleration_kwh,
            platooned_km=e.platooned_distance_m / 1000,
            baseline_driving_s=e.baseline_driving_s,
            cooperative_driving_s=e.cooperative_driving_s,
        )
    return CycleView(
        number=report.cycle,
        age_s=_age_s(report.started_ns, now_ns),
        status=status,
        level=level,
        reason=labels.reason(report.reason),
        solver=report.solver or "none",
        objective_kwh=report.objective_kwh,
        feasible=chosen.status in ("optimal", "feasible") if chosen else None,
        variables=report.variables,
        wall_s=report.wall_s,
        plans=report.plans,
        energy=energy,
        solvers=report.solvers,
        unserved=report.unserved,
    )


def _history(cycles: Sequence[CycleReport]) -> HistoryView:
    known = [(report.cycle, report.energy) for report in cycles if report.energy is not None]
    return HistoryView(
        cycles=tuple(number for number, _ in known),
        baseline_kwh=tuple(energy.baseline_kwh for _, energy in known),
        cooperative_kwh=tuple(energy.cooperative_kwh for _, energy in known),
    )

"""Builds the view model from the latest messages and the time; pure.

Fail safe: data that is stale or dated ahead is shown as unknown, never with its last value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dashboard.live import Snapshot
from dashboard.view import labels
from dashboard.view.dispatcher import dispatcher_status, hardware_status
from dashboard.view.labels import Level
from dashboard.view.model import (
    CycleView,
    DashboardView,
    EnergyView,
    HistoryView,
    PreviewView,
    RoadView,
    RsuView,
)
from dashboard.view.roads import open_roads, road_limits, road_views, stopped_lines
from dashboard.view.rsus import rsu_views
from dashboard.view.vehicles import silent_lines, vehicle_views
from slipstream import freshness
from slipstream.freshness import age_s as _age_s
from slipstream.messages import (
    CycleReport,
)


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
    limits = road_limits(snapshot.dispatcher, stale_after_s)
    last = snapshot.cycles[-1] if snapshot.cycles else None
    rsus = rsu_views(snapshot.rsus, now_ns, stale_after_s)
    roads = road_views(snapshot, now_ns, limits)
    dispatcher, dispatcher_level = dispatcher_status(snapshot, now_ns, silent_after_s)
    headline, headline_level = _headline(roads)
    vehicles = vehicle_views(snapshot, now_ns, open_roads(roads))
    return DashboardView(
        headline=headline,
        headline_level=headline_level,
        dispatcher=dispatcher,
        dispatcher_level=dispatcher_level,
        roads=roads,
        rsus=rsus,
        previews=_previews(snapshot.previews, rsus, now_ns, stale_after_s),
        vehicles=vehicles,
        cycle=cycle_view(last, now_ns) if last else None,
        history=_history(snapshot.cycles),
        problems=(
            *silent_lines(vehicles),
            *stopped_lines(snapshot, now_ns, limits),
            *((snapshot.history_problem,) if snapshot.history_problem else ()),
        ),
        device=_device(snapshot, now_ns, silent_after_s),
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
            age_s=_age_s(taken_ns, now_ns),
            stale=freshness.fault(taken_ns, now_ns, stale_after_s=stale_after_s) is not None,
            level=levels.get(rsu, "bad"),
        )
        for rsu, (jpeg, taken_ns) in sorted(previews.items())
    )


def cycle_view(report: CycleReport, now_ns: int) -> CycleView:
    """One dispatch cycle."""
    status, level = labels.CYCLE_STATUS[report.status]
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

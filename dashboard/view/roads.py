"""Builds the views of the watched roads; pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from dashboard.live import Snapshot, published_tolerance_s
from dashboard.view import labels
from dashboard.view.model import LIST_FOR_S, RoadView
from slipstream import freshness
from slipstream.messages import DispatcherHealth, Gate, SegmentState, StoppedVehicles

KMH_PER_MPS: Final = 3.6


@dataclass(frozen=True)
class RoadLimits:
    """Limits within which a SegmentState counts, s."""

    stale_after_s: float
    future_tolerance_s: float

    def fault(self, time_ns: int, now_ns: int) -> freshness.Fault | None:
        """Why data of a time count for nothing; None where they count."""
        return freshness.fault(
            time_ns,
            now_ns,
            stale_after_s=self.stale_after_s,
            future_tolerance_s=self.future_tolerance_s,
        )


def road_limits(dispatcher: DispatcherHealth | None, stale_after_s: float) -> RoadLimits:
    """The limits that the dispatcher publishes; an age limit of one's own where it has not."""
    published_s = None if dispatcher is None else dispatcher.stale_after_s
    return RoadLimits(
        stale_after_s=stale_after_s if published_s is None else published_s,
        future_tolerance_s=published_tolerance_s(dispatcher),
    )


@dataclass(frozen=True)
class RoadData:
    """The latest messages of one watched road.

    Attributes:
        watched_by: RSU that says that it watches it; empty: none.
        flag_since: UTC ns since when the flag of each state is what it is; None: not known.
    """

    segment: str
    watched_by: str
    states: tuple[SegmentState, ...] = ()
    stopped: tuple[StoppedVehicles, ...] = ()
    gate: Gate | None = None
    flag_since: tuple[int | None, ...] = ()

    def with_states(
        self, states: Sequence[SegmentState], flag_since: Mapping[tuple[str, str], int]
    ) -> RoadData:
        """The same road with other states."""
        since = tuple(flag_since.get((self.segment, state.rsu)) for state in states)
        return replace(self, states=tuple(states), flag_since=since)


def road_data(
    snapshot: Snapshot, now_ns: int, watching: Mapping[str, str] = MappingProxyType({})
) -> dict[str, RoadData]:
    """The messages by road, of all that are watched, by name."""
    last = snapshot.cycles[-1] if snapshot.cycles else None
    gates = {gate.segment: gate for gate in last.gates} if last else {}
    oldest_ns = now_ns - round(LIST_FOR_S * 1e9)
    watched_by = dict(watching) | {
        segment: health.rsu
        for health in snapshot.rsus.values()
        if health.time_ns > oldest_ns
        for segment in health.segments
    }
    states: dict[str, list[SegmentState]] = {}
    for (segment, _), state in snapshot.states.items():
        if state.time_ns > oldest_ns:
            states.setdefault(segment, []).append(state)
    stopped: dict[str, list[StoppedVehicles]] = {}
    for (segment, _), vehicles in snapshot.stopped.items():
        stopped.setdefault(segment, []).append(vehicles)
    return {
        segment: RoadData(
            segment,
            watched_by.get(segment, ""),
            stopped=tuple(stopped.get(segment, ())),
            gate=gates.get(segment),
        ).with_states(states.get(segment, ()), snapshot.flag_since)
        for segment in sorted({*watched_by, *states, *gates})
    }


def road_view(road: RoadData, cycle: int | None, now_ns: int, limits: RoadLimits) -> RoadView:
    """The view of one road."""
    decisive = freshness.decisive(
        road.states,
        now_ns,
        stale_after_s=limits.stale_after_s,
        future_tolerance_s=limits.future_tolerance_s,
    )
    state = None if decisive is None else decisive.state
    traffic: labels.Traffic = "unknown"
    code: str | None = "missing"
    since_ns = None
    if decisive is not None and decisive.fault is not None:
        code = decisive.fault
        if code == "stale":
            since_ns = decisive.state.time_ns + round(limits.stale_after_s * 1e9)
    elif state is not None:
        traffic, code = labels.traffic(state.y_e), state.reason
        pairs = zip(road.states, road.flag_since, strict=False)
        since_ns = next((since for other, since in pairs if other is state), None)
    speed = cv = vehicles = None
    if state is not None and traffic != "unknown":
        speed, cv, vehicles = measured(state)
    gate = road.gate
    return RoadView(
        segment=road.segment,
        rsu=state.rsu if state is not None else road.watched_by,
        traffic=traffic,
        reason=labels.reason(code),
        speed_kmh=speed,
        cv=cv,
        gate_cycle=cycle if gate else None,
        gate_open=gate is not None and gate.open,
        gate_reason="" if gate is None or gate.open else labels.gate_reason(gate.y_e, gate.reason),
        reason_code=code,
        vehicles=vehicles,
        since_ns=since_ns,
        stopped=sum(
            len(told.unusual) for told in road.stopped if limits.fault(told.time_ns, now_ns) is None
        ),
    )


def measured(state: SegmentState) -> tuple[float | None, float | None, int | None]:
    """Mean speed, km/h, its coefficient of variation, and the number of vehicles; None where the
    state does not tell them, or has no flag.
    """
    if state.y_e is None:
        return None, None, None
    if state.features is None:
        return None, None, state.vehicles
    mean_mps, spread_mps = state.features.mean_speed_mps.value, state.features.speed_std_mps.value
    cv = spread_mps / mean_mps if mean_mps > 0 else None
    return mean_mps * KMH_PER_MPS, cv, state.vehicles


def road_views(snapshot: Snapshot, now_ns: int, limits: RoadLimits) -> tuple[RoadView, ...]:
    """The views of all watched roads, by name."""
    cycle = snapshot.cycles[-1].cycle if snapshot.cycles else None
    return tuple(
        road_view(road, cycle, now_ns, limits) for road in road_data(snapshot, now_ns).values()
    )


def open_roads(roads: Collection[RoadView]) -> frozenset[str]:
    """Roads on which platoons may drive close now: an open gate, and traffic still stable."""
    return frozenset(road.segment for road in roads if road.platoons_allowed)

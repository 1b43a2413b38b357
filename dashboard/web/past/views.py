"""What the database tells of one moment, and views of roads and roadside units of it; pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from dashboard.view import labels
from dashboard.view.model import RoadView
from dashboard.view.places import Places
from dashboard.web.tables.rows import bare_rsu_row
from slipstream.messages import CycleReport, VehiclePlan
from slipstream.orders import IN_FORCE, OrderRecord, PlanRecord
from storage import Event, RollUp, SegmentAt

KMH_PER_MPS: Final = 3.6
ALARMS_BEGAN_S: Final = 14 * 86_400.0
"""Alarms that began longer before a moment are not looked for, s."""
ENDED_ALARMS_S: Final = 600.0
"""For so long an alarm that has ended is listed, s: as the dispatcher does."""


@dataclass(frozen=True)
class Facts:
    """All that is stored of a moment.

    Attributes:
        plans: of each vehicle, by vehicle; one may have ended.
        events: that began before, latest first.
        watched: roads by RSU, as far as is known now.
    """

    time_ns: int
    cycles: Sequence[CycleReport] = ()
    plans: Sequence[PlanRecord] = ()
    orders: Sequence[OrderRecord] = ()
    segments: Sequence[SegmentAt] = ()
    events: Sequence[Event] = ()
    energy: Mapping[str, Any] | None = None
    watched: Mapping[str, Sequence[str]] = field(default_factory=dict)

    @property
    def plans_in_force(self) -> dict[str, VehiclePlan]:
        """The plans that vehicles followed then, by vehicle."""
        return {
            record.plan.vehicle: record.plan for record in self.plans if record.status in IN_FORCE
        }

    @property
    def alarms(self) -> list[Event]:
        """Alarms in force then, or ended less than `ENDED_ALARMS_S` before."""
        oldest_ns = self.time_ns - round(ENDED_ALARMS_S * 1e9)
        return [
            event
            for event in self.events
            if event.alarm is not None and (event.ended_ns is None or event.ended_ns > oldest_ns)
        ]

    @property
    def paused(self) -> bool:
        """Whether the dispatcher was paused, as its alarm told."""
        return any(event.kind == "paused" and self.in_force(event) for event in self.alarms)

    def in_force(self, alarm: Event) -> bool:
        """Whether an alarm had not ended."""
        return alarm.ended_ns is None or alarm.ended_ns > self.time_ns


def road_views(facts: Facts) -> list[RoadView]:
    """The watched roads, by name."""
    watcher = {road: rsu for rsu, roads in facts.watched.items() for road in roads}
    cycle = facts.cycles[-1].cycle if facts.cycles else None
    return [
        road_view(at, watcher.get(at.gate.segment, ""), cycle)
        for at in sorted(facts.segments, key=lambda at: at.gate.segment)
    ]


def road_view(at: SegmentAt, rsu: str, cycle: int | None) -> RoadView:
    """A road: its flag is that of most states of the minute; without them that of its gate."""
    gate, rollup = at.gate, at.rollup
    traffic, code = labels.traffic(gate.y_e), gate.reason
    speed = cv = vehicles = None
    if rollup is not None:
        # An hour says nothing of a moment's flag.
        if rollup.period_s == 60:
            traffic = majority(rollup)
        vehicles = round(rollup.vehicles_mean)
        if traffic != "unknown":
            mean = {name: spread.mean for name, spread in rollup.features.items()}
            mean_mps = mean.get("mean_speed_mps")
            if mean_mps is not None:
                speed = mean_mps * KMH_PER_MPS
                cv = mean["speed_std_mps"] / mean_mps if mean_mps > 0 else None
    if traffic == "unknown" and code is None and rollup is None:
        code = "missing"
    return RoadView(
        segment=gate.segment,
        rsu=rsu,
        traffic=traffic,
        reason=labels.reason(code) if traffic == "unknown" else "",
        speed_kmh=speed,
        cv=cv,
        gate_cycle=cycle,
        gate_open=gate.open,
        gate_reason="" if gate.open else labels.gate_reason(gate.y_e, gate.reason),
        reason_code=code,
        vehicles=vehicles,
    )


def majority(rollup: RollUp) -> labels.Traffic:
    """What most states of a minute said; one that most did not judge is unknown."""
    if rollup.stable * 2 > rollup.count:
        return "stable"
    return "turbulent" if rollup.turbulent * 2 >= rollup.count else "unknown"


def rsu_rows(facts: Facts, places: Places) -> dict[str, dict[str, Any]]:
    """Roadside units: whether states of their roads had come. Their health is not stored."""
    came = {at.gate.segment: at.rollup for at in facts.segments if at.rollup is not None}
    return {rsu: _rsu_row(roads, came, places) for rsu, roads in sorted(facts.watched.items())}


def _rsu_row(roads: Sequence[str], came: Mapping[str, RollUp], places: Places) -> dict[str, Any]:
    heard = [came[road] for road in roads if road in came]
    status, level = "ok", "ok"
    if not came:
        # Nothing of this minute is stored, of nobody.
        status, level = "not known", "idle"
    elif not heard:
        status, level = "silent", "bad"
    elif not any(rollup.measured for rollup in heard):
        status, level = "measures nothing", "warn"
    vehicles = round(sum(rollup.vehicles_mean for rollup in heard)) if heard else None
    return bare_rsu_row(roads, places, status, level) | {"vehicles": vehicles}

"""The operator's page as JSON: rows of its tables, status, energy; pure. See docs/page.md.

A row has only what is shown, rounded to what is shown, and times in place of ages: one that tells
nothing new is equal to the one before.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any, Final

from dashboard.live import Snapshot
from dashboard.settings import Factors
from dashboard.view import labels
from dashboard.view.model import RoadView, RsuView, VehicleView, platoon_km
from dashboard.view.places import Places
from dashboard.view.troubles import Trouble
from slipstream.energy.ledger import EnergySum
from slipstream.messages import Alarm, CycleReport, EnergySummary, VehiclePlan

Row = dict[str, Any]
Rows = dict[str, Row]
Moment = dict[str, Any]

TABLES: Final = ("vehicles", "roads", "rsus", "orders", "cycles", "alarms")
ENDED_ORDERS_FOR_S: Final = 24 * 3600.0
MAX_ORDERS: Final = 5000
MAX_CYCLES: Final = 200
NO_FACTORS: Final = Factors(0.0, 0.0)
LATE_AFTER_S: Final = 300.0
"""Behind its plan, s: a vehicle beyond it is in trouble."""
_HARMLESS: Final = frozenset({"too_few_vehicles", "window_not_covered"})
"""Reasons of an unknown flag that are no fault."""


@dataclass(frozen=True)
class Scene:
    """What is known of roads and fleet beforehand.

    Attributes:
        depots: junctions by the name of their depot.
        vehicles: carriers by vehicle, of the whole fleet; None: it has none.
    """

    places: Places
    depots: Mapping[str, str] = field(default_factory=dict)
    vehicles: Mapping[str, str | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Known:
    """All that is known at one moment."""

    snapshot: Snapshot
    moment: Moment
    now_ns: int


def ms(time_ns: int | None) -> int | None:
    """UTC nanoseconds as a browser's milliseconds, to the nearest."""
    return None if time_ns is None else (time_ns + 500_000) // 1_000_000


def road_row(road: RoadView) -> Row:
    """One watched road."""
    level = "ok"
    if road.traffic == "turbulent":
        level = "warn"
    elif road.traffic == "unknown":
        level = "idle" if road.reason_code in _HARMLESS else "warn"
    return {
        "flag": road.traffic,
        "why": road.reason or None,
        **road_figures(road.speed_kmh, road.cv, road.vehicles),
        "gate": None if road.gate_cycle is None else "open" if road.platoons_allowed else "closed",
        "gate_why": _gate_why(road),
        "rsu": road.rsu or None,
        "stopped": road.stopped,
        "since": ms(road.since_ns),
        "level": "warn" if road.stopped and level == "ok" else level,
    }


def _gate_why(road: RoadView) -> str | None:
    """Why a gate is closed now: by the last cycle, or by the flag since."""
    if road.gate_cycle is None or road.platoons_allowed:
        return None
    if road.gate_open:
        now = "turbulent traffic" if road.traffic == "turbulent" else road.reason or "no data"
        return f"{now} now; cycle #{road.gate_cycle} had opened it"
    if road.traffic == "stable":
        return f"{road.gate_reason} in cycle #{road.gate_cycle}; the next one may open it"
    return road.gate_reason


def road_figures(speed_kmh: float | None, cv: float | None, vehicles: int | None) -> Row:
    """The fields of a road's row that change from state to state."""
    return {
        "kmh": None if speed_kmh is None else round(speed_kmh),
        "cv": None if cv is None else round(cv, 2),
        "vehicles": vehicles,
    }


def rsu_row(rsu: RsuView, scene: Scene, pictured: bool) -> Row:
    """One roadside unit."""
    fault, silent = rsu.health.fault, rsu.fps is None
    return bare_rsu_row(rsu.health.segments, scene.places, rsu.status, rsu.level) | {
        "fps": None if rsu.fps is None else round(rsu.fps),
        "latency_ms": None if rsu.latency_ms is None else round(rsu.latency_ms),
        "skipped_share": round(rsu.skipped_share, 3),
        "faults": [] if fault is None else [labels.camera_fault(fault)],
        "vehicles": 0 if silent else rsu.health.vehicles_in_view,
        # Of one that is heard each second the time tells nothing.
        "seen": ms(rsu.health.time_ns) if silent else None,
        "picture": pictured,
    }


def unheard_rsu_row(segments: Sequence[str], scene: Scene, overdue: bool) -> Row:
    """A roadside unit that only the settings tell of; overdue: it should have been heard by now."""
    told = ("never heard", "bad") if overdue else ("not heard yet", "idle")
    return bare_rsu_row(segments, scene.places, *told)


def bare_rsu_row(segments: Sequence[str], places: Places, status: str, level: str) -> Row:
    """A roadside unit of which no figures are known, by the roads that it watches."""
    middle = places.middle(tuple(segments))
    return {
        "x": None if middle is None else round(middle[0], 1),
        "y": None if middle is None else round(middle[1], 1),
        "status": status,
        "level": level,
        "why": None if level == "ok" else status,
        "fps": None,
        "latency_ms": None,
        "skipped_share": None,
        "faults": None,
        "segments": list(segments),
        "vehicles": None,
        "seen": None,
        "picture": False,
    }


@dataclass(frozen=True)
class TourRow:
    """What of a vehicle's plan stays the same for as long as it has it.

    Attributes:
        plan: the plan.
        shared: roads on which it is to drive in a platoon.
        route: its roads by their indices, those that are known.
        before: how many of them lie before each segment of the plan.
        left: stops to serve from each stop of the plan on.
        fixed: fields of its row.
    """

    plan: VehiclePlan
    shared: tuple[str, ...]
    route: tuple[tuple[int, str | None], ...]
    before: tuple[int, ...]
    left: tuple[int, ...]
    fixed: Row

    @classmethod
    def of(cls, plan: VehiclePlan, scene: Scene) -> TourRow:
        """The tour of a plan."""
        index = scene.places.index
        route: list[tuple[int, str | None]] = []
        before: list[int] = []
        for part in plan.segments:
            before.append(len(route))
            if part.segment in index:
                shared = part.segment if part.platoon is not None else None
                route.append((index[part.segment], shared))
        serve = {id(stop) for stop in plan.service_stops}
        left = accumulate((id(stop) in serve for stop in reversed(plan.stops)), initial=0)
        return cls(
            plan,
            tuple(sorted({road for _, road in route if road is not None})),
            tuple(route),
            tuple(before),
            tuple(left)[:0:-1],
            {
                "carrier": scene.vehicles.get(plan.vehicle),
                "kwh": round(plan.energy_kwh, 2),
                "km": round(plan.distance_m / 1000, 1),
                "platoon_km": round(platoon_km(plan), 1),
                "cycle": plan.cycle,
            },
        )

    def drawn(self, open_roads: Container[str]) -> list[list[int]]:
        """The route as a browser draws it: 1 where the vehicle may drive close now."""
        return [[index, int(road is not None and road in open_roads)] for index, road in self.route]


def vehicle_row(
    van: VehicleView,
    tour: TourRow,
    drawn: list[list[int]],
    scene: Scene,
    partners: Mapping[tuple[str, str], Sequence[str]],
    saved_kwh: float | None,
) -> Row:
    """One vehicle."""
    done, plan = van.progress, van.plan
    place = None if done.position is None else scene.places.on_road(*done.position)
    part = None if done.part is None else plan.segments[done.part]
    platoon = None
    if part is not None and done.on_road and part.segment in van.open_roads:
        platoon = part.platoon
    eta_ns = done.eta_ns(plan)
    together = partners.get((platoon, part.segment), ()) if part is not None and platoon else ()
    return {
        "x": None if place is None else round(place[0], 1),
        "y": None if place is None else round(place[1], 1),
        "heading": None if place is None else round(place[2]) % 360,
        "source": None if place is None else done.source,
        "state": done.state,
        "text": done.text,
        "road": None if done.position is None else done.position[0],
        "platoon": platoon,
        "place": part.place if part is not None and platoon else None,
        "with": [name for name in together if name != van.vehicle],
        "next": None if done.stop is None else plan.stops[done.stop].stop,
        "eta": ms(eta_ns),
        "delay_s": done.delay_s,
        "stops_left": 0 if done.stop is None else tour.left[done.stop],
        "seen": ms(van.silent_ns),
        "level": _vehicle_level(van, eta_ns),
        "route": drawn,
        "at": None if done.part is None else tour.before[done.part],
        "colour": van.colour,
        "charge_kwh": None if van.charge_kwh is None else round(van.charge_kwh, 1),
        "saved_kwh": None if saved_kwh is None else round(saved_kwh, 3),
        **tour.fixed,
    }


def _vehicle_level(van: VehicleView, eta_ns: int | None) -> str:
    done = van.progress
    if van.silence is not None:
        return van.silence
    # Of one that was never heard nothing is known to be well.
    well = "ok" if done.reported else "idle"
    if done.state == "idle":
        return "idle"
    if done.stop is not None and eta_ns is not None:
        latest_ns = van.plan.stops[done.stop].latest_ns
        if latest_ns is not None and eta_ns > latest_ns:
            return "bad"
    late = done.delay_s is not None and done.delay_s >= LATE_AFTER_S
    return "warn" if late or done.state == "expired" else well


def platoons(plans: Iterable[VehiclePlan]) -> dict[tuple[str, str], list[str]]:
    """The vehicles of each platoon on each road, by platoon and road, the leader first."""
    found: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for plan in plans:
        for part in plan.segments:
            if part.platoon is not None:
                key = part.platoon, part.segment
                found.setdefault(key, []).append((part.place or 0, plan.vehicle))
    return {key: [name for _, name in sorted(members)] for key, members in found.items()}


def alarm_row(alarm: Alarm) -> Row:
    """One alarm of the dispatcher's."""
    return {
        "severity": alarm.severity,
        "since": ms(alarm.since_ns),
        "subject": alarm.subject,
        "text": alarm.text,
        "mend": alarm.mend,
        "ended": ms(alarm.ended_ns),
        "by": alarm.acknowledged_by,
        "acknowledged": ms(alarm.acknowledged_ns),
    }


def own_alarm_row(trouble: Trouble, since_ms: int | None) -> Row:
    """One of the page's own, of what the dispatcher cannot tell."""
    return {
        "severity": "critical" if trouble.level == "bad" else "warning",
        "since": since_ms,
        "subject": trouble.subject,
        "text": trouble.text,
        "mend": trouble.mend,
        "ended": None,
        "by": None,
        "acknowledged": None,
    }


def cycle_row(report: CycleReport) -> Row:
    """One dispatch cycle."""
    energy = None if report.energy is None else cycle_energy(report.energy, NO_FACTORS)
    status, level = labels.CYCLE_STATUS[report.status]
    shown: str = level
    if level == "ok":
        # One that planned nothing says nothing of how the orders fare.
        shown = "warn" if report.unserved else "ok" if report.plans else "idle"
    return {
        "t": ms(report.started_ns),
        "status": status,
        "level": shown,
        "why": labels.reason(report.reason) or None,
        "wall_s": round(report.wall_s, 1),
        "plans": report.plans,
        "solver": report.solver,
        "variables": report.variables,
        "saved_kwh": None if energy is None else energy["saved_kwh"],
        "saved_share": None if energy is None else energy["saved_share"],
        "platoon_km": None if energy is None else energy["platoon_km"],
        "unserved": len(report.unserved),
    }


def cycle_energy(energy: EnergySummary, factors: Factors) -> Row:
    """What a cycle's plans save against their baseline; how far they lead is not known."""
    driven = EnergySum(
        0,
        baseline_kwh=energy.baseline_kwh,
        plan_kwh=energy.cooperative_kwh,
        saved_distance_kwh=energy.saved_distance_kwh,
        saved_drag_kwh=energy.saved_drag_kwh,
        saved_acceleration_kwh=energy.saved_acceleration_kwh,
        distance_m=0.0,
        platooned_m=energy.platooned_distance_m,
    )
    return sum_row(driven, factors, energy.baseline) | {"km": None}


def sum_row(driven: EnergySum, factors: Factors, baseline: str | None) -> Row:
    """What was driven in some time, and saved against the plan of this name, if it is known."""
    saved = driven.baseline_kwh - driven.plan_kwh
    return {
        "baseline": baseline,
        "baseline_kwh": round(driven.baseline_kwh, 3),
        "plan_kwh": round(driven.plan_kwh, 3),
        "saved_kwh": round(saved, 3),
        "saved_share": round(saved / driven.baseline_kwh, 4) if driven.baseline_kwh > 0 else 0.0,
        "distance_kwh": round(driven.saved_distance_kwh, 3),
        "drag_kwh": round(driven.saved_drag_kwh, 3),
        "acceleration_kwh": round(driven.saved_acceleration_kwh, 3),
        "km": round(driven.distance_m / 1000, 1),
        "platoon_km": round(driven.platooned_m / 1000, 1),
        "co2_kg": round(saved * factors.co2_kg_per_kwh, 3),
        "money": round(saved * factors.price_per_kwh, 2),
    }

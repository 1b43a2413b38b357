"""Parts of the cards; pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, Final

from dashboard.live import Snapshot
from dashboard.states import State
from dashboard.view import labels
from dashboard.web import rows
from dashboard.web.rows import Rows, Scene, ms
from dashboard.web.services import Known
from slipstream import freshness
from slipstream.messages import CycleReport, PlannedSegment, PlannedStop, VehiclePlan
from slipstream.orders import OrderChange, OrderRecord, PlanRecord
from slipstream.roads import Segment
from storage import RollUp

Part = dict[str, Any]

_FEATURES: Final = (
    ("mean_speed_mps", "mean speed", "km/h", 3.6, None),
    ("mean_acceleration_mps2", "mean acceleration", "m/s²", 1.0, None),
    ("density_veh_per_m", "density", "vehicles/km", 1000.0, None),
    ("speed_std_mps", "speed spread", "km/h", 3.6, "max_speed_cv"),
    (
        "acceleration_variance_m2ps4",
        "acceleration variance",
        "m²/s⁴",
        1.0,
        "max_acceleration_variance_m2ps4",
    ),
    ("mean_gap_m", "mean gap", "m", 1.0, None),
)
"""The six features: field, name, unit, factor to the unit, and which limit of a unit's it has."""


def plan_of(snapshot: Snapshot, vehicle: str, cycle: int) -> VehiclePlan | None:
    """The plan that a vehicle's row is by."""
    plans = (snapshot.followed.get(vehicle), snapshot.plans.get(vehicle))
    found = next((plan for plan in plans if plan is not None and plan.cycle == cycle), None)
    return found if found is not None and (found.stops or found.segments) else None


def plan_card(plan: VehiclePlan, row: Part, scene: Scene, orders: Rows) -> Part:
    """A plan as a timeline."""
    ahead = _ahead(plan, row)
    return {
        "cycle": plan.cycle,
        "issued": ms(plan.issued_ns),
        "depart": ms(plan.depart_ns),
        "valid_until": ms(plan.valid_until_ns),
        "energy_kwh": round(plan.energy_kwh, 2),
        "alone_kwh": None,
        "stops": [
            _stop(stop, number >= ahead, scene, orders.get(stop.stop))
            for number, stop in enumerate(plan.stops)
        ],
        "segments": [_segment(part) for part in plan.segments],
    }


def _ahead(plan: VehiclePlan, row: Part) -> int:
    """Number of the next stop; that of stops where none is left."""
    names = [stop.stop for stop in plan.stops]
    if row["next"] is None:
        return len(names)
    # A round ends where it began: the last of two with one name.
    return len(names) - 1 - names[::-1].index(row["next"])


def _stop(stop: PlannedStop, ahead: bool, scene: Scene, order: Part | None) -> Part:
    place = scene.places.at_node(stop.node)
    return {
        "id": stop.stop,
        "node": stop.node,
        "x": None if place is None else round(place[0], 1),
        "y": None if place is None else round(place[1], 1),
        "arrival": ms(stop.arrival_ns),
        "departure": ms(stop.departure_ns),
        "earliest": None if order is None else order["earliest"],
        "latest": ms(stop.latest_ns),
        "state": order["state"] if order is not None else "planned" if ahead else "passed",
        "wait_s": round(stop.wait_s),
        "is_hub": stop.is_hub,
        "charged_kwh": round(stop.charged_kwh, 1),
    }


def _segment(part: PlannedSegment) -> Part:
    return {
        "road": part.segment,
        "entry": ms(part.entry_ns),
        "exit": ms(part.exit_ns),
        "kmh": round(part.speed_mps * 3.6),
        "platoon": part.platoon,
        "place": part.place,
        "gap_m": part.gap_m,
    }


def why_route(plan: VehiclePlan, reports: Sequence[CycleReport]) -> list[str]:
    """Why a vehicle has this route, as far as plan and cycle tell."""
    stops = labels.plural(len(plan.service_stops), "stop")
    lines = [f"{stops} over {plan.distance_m / 1000:.1f} km for {plan.energy_kwh:.2f} kWh"]
    if plan.continues is not None:
        lines.append(f"It goes on from its plan of cycle #{plan.continues}")
    report = next((one for one in reports if one.cycle == plan.cycle), None)
    if report is not None and report.status == "ok" and report.energy is not None:
        saved = report.energy.baseline_kwh - report.energy.cooperative_kwh
        lines.append(
            f"The plans of cycle #{plan.cycle}, found by {report.solver or 'no solver'}, need "
            f"{saved:.2f} kWh less than {report.energy.baseline}"
        )
    elif report is not None and report.status == "baseline":
        why = labels.reason(report.reason) or "nothing better was found"
        lines.append(f"It is the baseline's: {why}")
    waits = sum(stop.wait_s for stop in plan.stops)
    if waits:
        lines.append(f"It waits {waits:.0f} s in all for other vehicles")
    return lines


def why_platoon(vehicle: str, plan: VehiclePlan, known: Known, scene: Scene) -> list[str]:
    """With whom a vehicle is to drive where, and where it may not drive close now."""
    lines = []
    for platoon, group in groupby(plan.segments, key=lambda part: part.platoon):
        if platoon is None:
            continue
        stretch = list(group)
        with_whom = [
            name
            for name in _members(known.snapshot, platoon, stretch[0].segment)
            if name != vehicle
        ]
        names = ", ".join(with_whom) or "nobody any more"
        shut = [part.segment for part in stretch if not _is_open(known, part.segment)]
        metres = sum(
            scene.places.network.segments[p.segment].length_m
            for p in stretch
            if p.segment in scene.places.index
        )
        line = f"With {names} for {metres / 1000:.1f} km from {_named(stretch[0].segment, scene)}"
        if shut:
            why = (known.moment["roads"].get(shut[0]) or {}).get("why") or "its gate is closed"
            line += f"; not close on {_named(shut[0], scene)}: {why}"
        lines.append(line)
    return lines


def _members(snapshot: Snapshot, platoon: str, road: str) -> list[str]:
    found = []
    for plan in snapshot.plans.values():
        for part in plan.segments:
            if part.platoon == platoon and part.segment == road:
                found.append((part.place or 0, plan.vehicle))
                break
    return [name for _, name in sorted(found)]


def _is_open(known: Known, road: str) -> bool:
    row = known.moment["roads"].get(road)
    return row is not None and row["flag"] == "stable" and row["gate"] != "closed"


def _named(road: str, scene: Scene) -> str:
    segment = scene.places.network.segments.get(road)
    return road if segment is None or not segment.name else f"{segment.name} ({road})"


def plan_history(record: PlanRecord) -> Part:
    """What became of a plan."""
    return {
        "cycle": record.plan.cycle,
        "issued": ms(record.plan.issued_ns),
        "status": record.status,
        "reason": record.reason,
    }


def road_facts(segment: Segment | None) -> Part:
    """What the network says of a road."""
    return {
        "name": None if segment is None else segment.name or None,
        "length_m": None if segment is None else round(segment.length_m, 1),
        "limit_kmh": None if segment is None else round(segment.speed_limit_mps * 3.6),
    }


def features(road: str, known: Known) -> list[Part]:
    """The six features of the state that a road is judged by, with the limits that they are
    held against.
    """
    row = known.moment["roads"].get(road)
    state = None if row is None else known.snapshot.states.get((road, row["rsu"] or ""))
    measured = None if state is None else state.features
    if state is None or measured is None:
        return []
    if freshness.fault(state.time_ns, known.now_ns) is not None:
        return []
    limits = _limits_of(known.snapshot, state)
    found = []
    for field, name, unit, factor, limit in _FEATURES:
        estimate = getattr(measured, field)
        if estimate is None:
            continue
        threshold = limits.get(limit or "")
        if threshold is not None and limit == "max_speed_cv":
            # Held against a share of the mean speed.
            threshold *= measured.mean_speed_mps.value
        error = estimate.standard_error
        found.append(
            {
                "name": name,
                "value": round(estimate.value * factor, 3),
                "unit": unit,
                "standard_error": None if error is None else round(error * factor, 3),
                "threshold": None if threshold is None else round(threshold * factor, 3),
                "crossed": threshold is not None and estimate.value > threshold,
            }
        )
    return found


def _limits_of(snapshot: Snapshot, state: State) -> Mapping[str, float | None]:
    health = snapshot.rsus.get(state.rsu)
    limits = None if health is None else health.stability
    return {} if limits is None else limits.model_dump()


def hour(minutes: Sequence[RollUp]) -> Part:
    """The last hour by minutes."""

    def series(feature: str, factor: float, which: int = 0, digits: int = 2) -> list[float | None]:
        return [
            round(minute.features[feature][which] * factor, digits)
            if feature in minute.features
            else None
            for minute in minutes
        ]

    speeds, spreads = series("mean_speed_mps", 1.0, 0, 6), series("speed_std_mps", 1.0, 0, 6)
    return {
        "t": [ms(minute.began_ns) for minute in minutes],
        "kmh": series("mean_speed_mps", 3.6, 0, 1),
        "kmh_low": series("mean_speed_mps", 3.6, 1, 1),
        "kmh_high": series("mean_speed_mps", 3.6, 2, 1),
        "variance": series("acceleration_variance_m2ps4", 1.0),
        "cv": [
            round(spread / speed, 3) if spread is not None and speed else None
            for speed, spread in zip(speeds, spreads, strict=True)
        ],
        "density": series("density_veh_per_m", 1000.0, 0, 1),
        "headway": series("mean_gap_m", 1.0, 0, 1),
        "flag": [_flag(minute) for minute in minutes],
    }


def _flag(minute: RollUp) -> str:
    """What most states of a minute said; one that most did not judge is unknown."""
    if minute.stable * 2 > minute.count:
        return "stable"
    return "turbulent" if minute.turbulent * 2 >= minute.count else "unknown"


def refused(road: str, known: Known) -> list[Part]:
    """Whom the last cycle's closed gate keeps apart: those whose plans lead over the road."""
    report = known.snapshot.cycles[-1] if known.snapshot.cycles else None
    gate = next((gate for gate in report.gates if gate.segment == road), None) if report else None
    if report is None or gate is None or gate.open:
        return []
    vehicles = sorted(
        plan.vehicle
        for plan in known.snapshot.plans.values()
        if any(part.segment == road and part.exit_ns > known.now_ns for part in plan.segments)
    )
    if len(vehicles) < 2:
        return []
    return [
        {
            "cycle": report.cycle,
            "t": ms(report.started_ns),
            "vehicles": vehicles,
            "why": labels.gate_reason(gate.y_e, gate.reason),
        }
    ]


def stopped(road: str, known: Known) -> list[Part]:
    """Vehicles that stand on a road as in no queue."""
    return [
        {"lane": one.lane, "along_m": round(one.along_m), "since": ms(one.since_ns)}
        for (segment, _), told in known.snapshot.stopped.items()
        if segment == road and freshness.fault(told.time_ns, known.now_ns) is None
        for one in told.unusual
    ]


def rsu_facts(rsu: str, snapshot: Snapshot) -> Part:
    """What a unit's health and the dispatcher say of it beside its row."""
    health = snapshot.rsus.get(rsu)
    heard = () if snapshot.dispatcher is None else snapshot.dispatcher.rsus
    reception = next((one for one in heard if one.rsu == rsu), None)
    told: Part = {} if health is None else health.model_dump()
    return {
        "source": told.get("source"),
        "started": ms(told.get("started_ns")),
        "frames": told.get("frames"),
        "repeated": told.get("frames_repeated"),
        "decode_errors": told.get("decode_errors"),
        "reconnects": told.get("reconnects"),
        "rss_mb": told.get("rss_mb"),
        "reception": None
        if reception is None
        else {
            "received": reception.received,
            "missed": reception.missed,
            "duplicates": reception.duplicates,
            "out_of_order": reception.out_of_order,
            "delay_s": reception.delay_s,
        },
        "calibration": None,
    }


def order_step(change: OrderChange) -> Part:
    """One change in an order's life."""
    return {
        "t": ms(change.time_ns),
        "state": change.state,
        "reason": change.reason,
        "vehicle": change.vehicle,
        "cycle": change.cycle,
    }


def order_facts(order: OrderRecord | None) -> Part:
    """What an order asks for beside its row."""
    request = (order.request if order is not None else None) or {}
    return {
        "demand": None if order is None else order.demand,
        "mass_kg": request.get("mass_kg"),
        "service_s": None if order is None else order.service_s,
        "skills": list(request.get("skills", ())),
    }


def cycle_card(report: CycleReport, factors: Mapping[str, float]) -> Part:
    """All about a cycle."""
    energy = None if report.energy is None else rows.energy_sum(report.energy, **factors)
    return {
        "n": report.cycle,
        **rows.cycle_row(report),
        "solvers": [run.model_dump(mode="json") for run in report.solvers],
        "unserved": [{"stop": one.stop, "reason": one.reason} for one in report.unserved],
        "energy": energy,
        "explain": None,
    }

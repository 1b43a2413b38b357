"""Parts of a vehicle's card: its plan, and why it is so; pure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any, Final

from dashboard.live import Snapshot
from dashboard.view import labels
from dashboard.web.tables.rows import Known, Rows, Scene, ms
from slipstream.explain import Explanation
from slipstream.messages import CycleReport, PlannedSegment, PlannedStop, VehiclePlan
from slipstream.orders import PlanRecord, drafting_kwh

Part = dict[str, Any]

MAX_REFUSED: Final = 8
"""Platoons that a vehicle does not have, on its card; most worth first."""


def plan_of(snapshot: Snapshot, vehicle: str, cycle: int) -> VehiclePlan | None:
    """The plan that a vehicle's row is by."""
    plans = (snapshot.followed.get(vehicle), snapshot.plans.get(vehicle))
    found = next((plan for plan in plans if plan is not None and plan.cycle == cycle), None)
    return found if found is not None and (found.stops or found.segments) else None


def plan_card(
    plan: VehiclePlan, row: Part, scene: Scene, orders: Rows, records: Sequence[PlanRecord]
) -> Part:
    """A plan as a timeline."""
    ahead = _ahead(plan, row)
    saved_kwh = drafting_kwh(records).get((plan.vehicle, plan.cycle))
    return {
        "cycle": plan.cycle,
        "issued": ms(plan.issued_ns),
        "depart": ms(plan.depart_ns),
        "valid_until": ms(plan.valid_until_ns),
        "energy_kwh": round(plan.energy_kwh, 3),
        "alone_kwh": None if saved_kwh is None else round(plan.energy_kwh + saved_kwh, 3),
        "stops": [
            _stop(stop, number >= ahead, scene, orders.get(stop.stop))
            for number, stop in enumerate(plan.stops)
        ],
        "segments": [_segment(part) for part in plan.segments],
    }


def _ahead(plan: VehiclePlan, row: Part) -> int:
    """Number of the next stop; that of stops where none is left."""
    names = [stop.stop for stop in plan.stops]
    if row["state"] == "planned":
        # Nobody has heard that it passed any.
        return 0
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


def why_route(
    plan: VehiclePlan, reports: Sequence[CycleReport], told: Explanation | None
) -> list[str]:
    """Why a vehicle has this route, as far as plan and cycle tell."""
    if told is not None and told.vehicles[0].account is not None:
        own = told.vehicles[0]
        return [sentence(line) for line in own.lines if line not in own.platoons]
    stops = labels.plural(len(plan.service_stops), "stop")
    lines = [f"{stops} over {plan.distance_m / 1000:.1f} km for {plan.energy_kwh:.2f} kWh"]
    if plan.continues is not None:
        lines.append(f"It goes on from its plan of cycle #{plan.continues}")
    report = next((one for one in reports if one.cycle == plan.cycle), None)
    if report is not None and report.status == "ok" and report.energy is not None:
        lines.append(
            f"The plans of cycle #{plan.cycle}, found by {report.solver or 'no solver'}, need "
            f"{report.energy.saved_kwh:.2f} kWh less than {report.energy.baseline}"
        )
    elif report is not None and report.status == "baseline":
        why = labels.reason(report.reason) or "nothing better was found"
        lines.append(f"It is the baseline's: {why}")
    waits = sum(stop.wait_s for stop in plan.stops)
    if waits:
        lines.append(f"It waits {waits:.0f} s in all for other vehicles")
    return lines


def sentence(line: str) -> str:
    """A line that begins with a verb, as a sentence begins."""
    return line[:1].upper() + line[1:]


def why_platoon(
    vehicle: str, plan: VehiclePlan, known: Known, scene: Scene, told: Explanation | None
) -> list[str]:
    """With whom a vehicle is to drive where, where it may not drive close now, and with whom it was
    not to drive, and why.
    """
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
    if told is not None:
        lines += [f"Not: {one.line}" for one in told.refused[:MAX_REFUSED]]
        if (more := len(told.refused) - MAX_REFUSED) > 0:
            lines.append(
                f"And {more} more that it does not have: on the card of cycle #{plan.cycle}"
            )
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

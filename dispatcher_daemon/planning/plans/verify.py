"""Verification of plans on the messages themselves, before they are published.

It depends only on roads, fleet, open gates and rules, not on the code that made the plans.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import pairwise

from dispatcher_daemon.fleet import Commitment, Fleet
from dispatcher_daemon.planning.plans.verify_vehicles import (
    access_faults,
    charge_faults,
    legs_of,
    profile_of,
)
from slipstream.messages import PlannedSegment, VehiclePlan
from slipstream.roads import RoadNetwork
from slipstream.service.tracing import traced
from slipstream.spacing import MOST_VEHICLES

_TOLERANCE_NS = 1_000_000
_SPEED_TOLERANCE = 1e-3


@traced("verify")
def verify_plans(
    plans: Sequence[VehiclePlan],
    network: RoadNetwork,
    fleet: Fleet,
    open_segments: Collection[str],
    sync_window_s: float,
    *,
    longest: int = MOST_VEHICLES,
    unserved: Collection[str] = (),
    reference_s: float = 0.0,
    joined: Sequence[tuple[str, PlannedSegment]] = (),
    commitments: Sequence[Commitment] = (),
) -> tuple[str, ...]:
    """Check the plans of one cycle.

    A vehicle without a plan stays idle; a bound one has to have one, from where it is. What is late
    of a bound vehicle is no fault: it is loaded.

    Args:
        longest: number of vehicles that a platoon has at most.
        reference_s: from the issue of the plans to the moment that the fleet's times count from.
        joined: segments that vehicles on the road pass in platoons with those of the plans.

    Returns:
        Faults, one line each; empty if the plans may be published.
    """
    bound = {own.vehicle: own for own in commitments}
    of_plan = [(plan, bound.get(plan.vehicle)) for plan in plans]
    return (
        *_fleet_faults(plans, fleet, unserved, bound),
        *(
            f"{plan.vehicle}: {fault}"
            for plan, own in of_plan
            for fault in (
                *_window_faults(plan, fleet, reference_s, own),
                *_stop_faults(plan, fleet, unserved, own),
                *_path_faults(plan, network, own),
                *access_faults(plan, network, fleet, own),
                *_time_faults(plan, network, fleet, own),
                *_break_faults(plan, fleet, reference_s, own),
                *charge_faults(plan, network, fleet, reference_s, own),
                *_commitment_faults(plan, own),
            )
        ),
        *_platoon_faults(plans, open_segments, sync_window_s, longest, joined),
    )


def _commitment_faults(plan: VehiclePlan, own: Commitment | None) -> Iterator[str]:
    if plan.continues != (None if own is None else own.continues):
        yield f"continues the plan of cycle {plan.continues}"
    if own is None:
        return
    stops = [stop.stop for stop in plan.service_stops]
    if sorted(stops) != sorted(own.stops) or tuple(stops[: len(own.legs)]) != own.fixed_stops:
        yield "does not serve what it has loaded, or not in the order that is fixed"
    for number, (fixed, leg) in enumerate(zip(own.legs, legs_of(plan), strict=False)):
        driven = tuple(segment.segment for segment in leg)
        if driven[: len(fixed.path)] != fixed.path or (fixed.complete and driven != fixed.path):
            yield f"leaves the fixed way of leg {number}"


def _fleet_faults(
    plans: Sequence[VehiclePlan], fleet: Fleet, unserved: Collection[str], bound: Collection[str]
) -> Iterator[str]:
    count = Counter(plan.vehicle for plan in plans)
    yield from (f"{vehicle}: is bound and has no plan" for vehicle in bound if not count[vehicle])
    for vehicle in fleet.vehicles:
        if count.pop(vehicle.id, 0) > 1:
            yield f"{vehicle.id}: has more than one plan"
    for unknown in count:
        yield f"{unknown}: not in the fleet"
    served = Counter(stop.stop for plan in plans for stop in plan.stops[1:-1])
    for stop in fleet.stops:
        if served[stop.id] != (0 if stop.id in unserved else 1):
            yield f"stop {stop.id}: served {served[stop.id]} times"
    if len({(plan.cycle, plan.issued_ns) for plan in plans}) > 1:
        yield "plans of different cycles"


def _window_faults(
    plan: VehiclePlan, fleet: Fleet, reference_s: float, own: Commitment | None
) -> Iterator[str]:
    begin_ns = plan.issued_ns + round(reference_s * 1e9)

    def late(time_ns: int, limit_s: float) -> bool:
        return time_ns > begin_ns + round(limit_s * 1e9) + _TOLERANCE_NS

    vehicle = fleet.vehicle_by_id.get(plan.vehicle)
    if vehicle is None or not plan.stops:
        return
    leave_by_s = vehicle.ready_s if vehicle.depart_by_s is None else vehicle.depart_by_s
    early_ns = begin_ns + round(vehicle.ready_s * 1e9) - _TOLERANCE_NS
    if own is None and (plan.depart_ns < early_ns or late(plan.depart_ns, leave_by_s)):
        yield "leaves outside its window"
    back_ns = plan.stops[-1].arrival_ns
    if own is None and vehicle.return_by_s is not None and late(back_ns, vehicle.return_by_s):
        yield "is back too late"
    stops = [(s, fleet.stop_by_id[s.stop]) for s in plan.stops[1:-1] if s.stop in fleet.stop_by_id]
    for visit, stop in stops:
        begins_ns = visit.departure_ns - round((stop.service_s + visit.wait_s) * 1e9)
        if begins_ns < begin_ns + round(stop.earliest_s * 1e9) - _TOLERANCE_NS:
            yield f"serves {stop.id} before its window"
        if own is None and stop.latest_s is not None and late(visit.arrival_ns, stop.latest_s):
            yield f"comes to {stop.id} after its window"
    for _, stop in stops:
        if not fleet.may_serve(vehicle, stop):
            other = stop.carrier not in (None, vehicle.carrier)
            whose = f"carrier {stop.carrier}" if other else "other vehicles"
            yield f"serves {stop.id}, which is for {whose}"
    overload = fleet.overload(vehicle, (stop for _, stop in stops))
    if overload is not None:
        yield f"carries {overload}"


def _break_faults(
    plan: VehiclePlan, fleet: Fleet, reference_s: float, own: Commitment | None
) -> Iterator[str]:
    """Breaks of a free vehicle, in their windows and whole; a bound one has had them."""
    vehicle = fleet.vehicle_by_id.get(plan.vehicle)
    if vehicle is None or not plan.stops or own is not None:
        return
    begin_ns = plan.issued_ns + round(reference_s * 1e9)
    tolerance_s = 1e-9 * _TOLERANCE_NS
    taken = [stop for stop in plan.stops if stop.kind == "break"]
    leaves_s = 1e-9 * (plan.depart_ns - begin_ns) + tolerance_s
    back_s = 1e-9 * (plan.stops[-1].arrival_ns - begin_ns) - tolerance_s
    at_depot = vehicle.breaks_at_depot(leaves_s, back_s)
    for number, pause in enumerate(vehicle.breaks):
        for stop in [stop for stop in taken if stop.stop == vehicle.break_id(number)]:
            earliest_s = max(pause.earliest_s, 1e-9 * (stop.arrival_ns - begin_ns))
            ends_s = 1e-9 * (stop.departure_ns - begin_ns)
            whole = ends_s - earliest_s >= pause.duration_s - tolerance_s
            same = abs(stop.break_s - pause.duration_s) < tolerance_s
            if same and whole and earliest_s <= pause.latest_s + tolerance_s:
                taken.remove(stop)
                break
        else:
            if number not in at_depot:
                yield f"has no break of {pause.duration_s:g} s in its window"
    yield from (f"takes a break that it does not have, {stop.stop}" for stop in taken)


def _stop_faults(
    plan: VehiclePlan, fleet: Fleet, unserved: Collection[str], own: Commitment | None
) -> Iterator[str]:
    if len(plan.stops) < (3 if own is None or own.stops else 2):
        yield "serves no stop"
        return
    vehicle = fleet.vehicle_by_id.get(plan.vehicle)
    if vehicle is not None:
        depot = fleet.depot_of(vehicle)
        first, last = plan.stops[0], plan.stops[-1]
        if own is None and (first.stop, first.node) != (depot.id, depot.node):
            yield "does not start at its depot"
        if own is not None and (first.stop, first.node) != (own.place, own.node):
            yield "does not start at the place that it left last"
        if (last.stop, last.node) != (depot.id, depot.node):
            yield "does not end at its depot"
    for before, stop in pairwise(plan.stops[:-1]):
        if stop.kind == "break":
            if not stop.is_hub or stop.node != before.node or stop.stop in fleet.stop_by_id:
                yield f"no break {stop.stop} at node {stop.node}"
            continue
        hub, other = stop.stop in fleet.hub_by_id, stop.stop in fleet.charging_stop_by_id
        known = hub if stop.is_hub else other or stop.stop in fleet.stop_by_id
        if not known or fleet.node(stop.stop) != stop.node:
            yield f"no stop {stop.stop} at node {stop.node}"
    served = [stop.stop for stop in plan.stops[1:-1] if stop.stop in fleet.stop_by_id]
    for vehicle in fleet.vehicles:
        free = vehicle.first_stop is None or vehicle.first_stop in unserved
        if vehicle.id == plan.vehicle and not free and [vehicle.first_stop] != served[:1]:
            yield f"does not serve {vehicle.first_stop} first"


def _path_faults(plan: VehiclePlan, network: RoadNetwork, own: Commitment | None) -> Iterator[str]:
    numbers = [segment.leg for segment in plan.segments]
    driven_legs = {
        n for n, (a, b) in enumerate(pairwise(plan.stops)) if a.node != b.node or n in numbers
    }
    if numbers != sorted(numbers) or set(numbers) != driven_legs:
        yield "its legs are not one after another between its stops"
        return
    unknown = [s.segment for s in plan.segments if s.segment not in network.segments]
    if unknown:
        yield f"unknown segments {unknown}"
        return
    for number, leg in enumerate(legs_of(plan)):
        if not leg:
            continue
        roads = [network.segments[segment.segment] for segment in leg]
        on_its_way = number == 0 and own is not None and own.moving is not None
        begins = on_its_way or roads[0].start == plan.stops[number].node
        if not begins or roads[-1].end != plan.stops[number + 1].node:
            yield f"leg {number} does not join its stops"
        for a, b in pairwise(roads):
            if a.end != b.start or b.id not in network.turns(a.id):
                yield f"no turn from {a.id} into {b.id}"
    driven = sum(network.segments[s.segment].length_m for s in plan.segments)
    if abs(driven - plan.distance_m) > 1.0:
        yield f"distance is {driven:.0f} m, not {plan.distance_m:.0f} m"


def _time_faults(
    plan: VehiclePlan, network: RoadNetwork, fleet: Fleet, own: Commitment | None
) -> Iterator[str]:
    if not plan.stops:
        return
    # One that moves has left already: its first time is that of the segment that it is on.
    early = plan.depart_ns < plan.issued_ns and (own is None or own.moving is None)
    if early or plan.depart_ns != plan.stops[0].departure_ns:
        yield "leaves before its plan is issued, or at another time than its first stop says"
    if plan.valid_until_ns <= plan.issued_ns:
        yield "is valid until before it is issued"
    for stop in plan.stops:
        known = fleet.stop_by_id.get(stop.stop)
        needed_ns = 0 if known is None else round(known.service_s * 1e9)
        stays_ns = stop.departure_ns - stop.arrival_ns - round(stop.wait_s * 1e9)
        if stays_ns < needed_ns - _TOLERANCE_NS:
            yield f"leaves {stop.stop} before it is served"
    for number, leg in enumerate(legs_of(plan)):
        if not leg:
            if plan.stops[number + 1].arrival_ns != plan.stops[number].departure_ns:
                yield f"takes time for leg {number}, which has no way"
            continue
        begins = [segment.entry_ns for segment in leg]
        ends = [segment.exit_ns for segment in leg]
        expected = [plan.stops[number].departure_ns, *ends[:-1]]
        if begins != expected or ends[-1] != plan.stops[number + 1].arrival_ns:
            yield f"the times of leg {number} do not join up"
    profile = profile_of(fleet, plan.vehicle)
    top_mps = math.inf if profile.max_speed_mps is None else profile.max_speed_mps
    for segment in plan.segments:
        road = network.segments.get(segment.segment)
        if road is None:
            continue
        allowed_mps = road.access.speed_limit_mps(road.speed_limit_mps, profile)
        limit = min(allowed_mps, top_mps) * (1 + _SPEED_TOLERANCE)
        seconds = (segment.exit_ns - segment.entry_ns) * 1e-9
        if segment.speed_mps > limit or seconds <= 0 or road.length_m / seconds > limit:
            yield f"faster than allowed on {segment.segment}"


def _platoon_faults(
    plans: Sequence[VehiclePlan],
    open_segments: Collection[str],
    sync_window_s: float,
    longest: int,
    joined: Sequence[tuple[str, PlannedSegment]],
) -> Iterator[str]:
    groups: dict[tuple[str, str], list[tuple[str, PlannedSegment]]] = {}
    planned = [(plan.vehicle, segment) for plan in plans for segment in plan.segments]
    for vehicle, segment in (*planned, *joined):
        where = f"{vehicle} on {segment.segment}"
        if segment.platoon is None:
            if segment.place is not None or segment.gap_m is not None:
                yield f"{where}: a place or gap without a platoon"
            if segment.drafting_share is not None:
                yield f"{where}: drafting without a platoon"
            continue
        if segment.segment not in open_segments:
            yield f"{where}: platoon where the gate is closed"
        if segment.place is None or (segment.place > 0) != (segment.gap_m is not None):
            yield f"{where}: a gap is for followers, and for each of them"
        groups.setdefault((segment.segment, segment.platoon), []).append((vehicle, segment))
    for (road, name), members in groups.items():
        faults = _group_faults(members, sync_window_s, longest)
        yield from (f"platoon {name} on {road}: {fault}" for fault in faults)


def _group_faults(
    members: Sequence[tuple[str, PlannedSegment]], sync_window_s: float, longest: int
) -> Iterable[str]:
    ordered = sorted(members, key=lambda m: -1 if m[1].place is None else m[1].place)
    if len({vehicle for vehicle, _ in members}) < max(2, len(members)):
        yield "fewer than two vehicles, or one of them twice"
    if len(members) > longest:
        yield f"{len(members)} vehicles, more than the {longest} that their brakes allow"
    if [segment.place for _, segment in ordered] != list(range(len(members))):
        yield "places are not 0, 1, 2 ..."
    entries = [segment.entry_ns for _, segment in ordered]
    if entries != sorted(entries):
        yield "places are not in the order of entry"
    if max(entries) - min(entries) > sync_window_s * 1e9 + _TOLERANCE_NS:
        yield f"entry times more than {sync_window_s:g} s apart"

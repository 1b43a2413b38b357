"""From a vehicle's plan and position to what it is bound to."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

from dispatcher_daemon.fleet.commitments import Commitment, CommittedLeg, Moving
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle
from slipstream.messages import PlannedSegment, VehiclePlan, VehiclePosition, Visit

_CLOCK_ERROR_NS: Final = 2 * 10**9
"""A position dated further than this from its arrival is taken as measured when it came."""


def commitment(
    vehicle: TrackedVehicle, held: Collection[str], now_ns: int, horizon_ns: int
) -> Commitment:
    """What a vehicle with an accepted plan and a fresh position is bound to.

    Fixed are the segment that it is on and the next one of the same leg, all segments that it will
    have entered when the new plan is out, and the order of the stops that these lead to.

    Args:
        horizon_ns: when the new plan is out, UTC.
    """
    assert vehicle.accepted is not None
    assert vehicle.position is not None
    plan, position = vehicle.accepted.plan, vehicle.position
    lost = position.cycle != plan.cycle
    leg = min(vehicle.leg, len(plan.stops) - 2)
    legs = legs_of(plan)
    place = plan.stops[leg]
    stops = tuple(stop.stop for stop in plan.stops[leg + 1 : -1] if stop.stop in held)
    moving, at = None, None
    arrived_ns, late_ns = place.arrival_ns, 0
    ends_ns = departs_ns = place.departure_ns
    if position.on_road:
        moving = Moving(position.share, position.speed_mps, _measured_ns(vehicle, now_ns))
        at = _index(legs[leg], position, now_ns)
        if at is not None:
            late_ns = _late_ns(legs[leg][at], position, moving.time_ns)
    elif vehicle.left:
        visit = _visit(vehicle, place.stop)
        ends_ns = place.departure_ns - round(place.wait_s * 1e9)
        if visit is not None:
            arrived_ns = visit.arrived_ns
            if leg > 0:  # a plan that begins at the stop where it stands knows what is left
                ends_ns += arrived_ns - place.arrival_ns
        if visit is not None and visit.ended_ns is not None:
            ends_ns = visit.ended_ns
        departs_ns = max(ends_ns, now_ns)
        if place.wait_s > 0:
            departs_ns = max(ends_ns, place.departure_ns, now_ns)
        late_ns = departs_ns - place.departure_ns
    else:
        departs_ns = max(place.departure_ns, now_ns)
        late_ns = departs_ns - place.departure_ns
    if position.on_road and at is None:
        committed = [CommittedLeg((position.segment,), False)]
    else:
        targets = [stop.stop for stop in plan.stops[leg + 1 : -1]]
        committed = _committed(legs[leg:], targets, stops, horizon_ns - late_ns, at)
    return Commitment(
        vehicle=vehicle.id,
        plan=plan,
        place=place.stop,
        node=place.node,
        arrived_ns=arrived_ns,
        ends_ns=ends_ns,
        departs_ns=departs_ns,
        moving=moving,
        legs=tuple(committed),
        stops=stops,
        under_way=vehicle.left,
        lost=lost,
    )


def behind_s(vehicle: TrackedVehicle, now_ns: int) -> float:
    """By how much a vehicle that drives is behind its accepted plan, s; 0: it stands, or it is not
    known.
    """
    assert vehicle.accepted is not None
    position = vehicle.position
    if position is None or not position.on_road:
        return 0.0
    legs = legs_of(vehicle.accepted.plan)
    leg = legs[min(vehicle.leg, len(legs) - 1)]
    at = _index(leg, position, now_ns)
    if at is None:
        return 0.0
    return 1e-9 * _late_ns(leg[at], position, _measured_ns(vehicle, now_ns))


def _late_ns(planned: PlannedSegment, position: VehiclePosition, measured_ns: int) -> int:
    """By how much a vehicle is behind its plan on a segment."""
    driven_ns = round(position.share * (planned.exit_ns - planned.entry_ns))
    return measured_ns - planned.entry_ns - driven_ns


def legs_of(plan: VehiclePlan) -> list[list[PlannedSegment]]:
    """A plan's segments by leg."""
    legs: list[list[PlannedSegment]] = [[] for _ in plan.stops[1:]]
    for segment in plan.segments:
        legs[segment.leg].append(segment)
    return legs


def _measured_ns(vehicle: TrackedVehicle, now_ns: int) -> int:
    """When its position was measured, by the dispatcher's clock."""
    assert vehicle.position is not None
    measured_ns = vehicle.position.time_ns
    if abs(measured_ns - vehicle.heard_ns) > _CLOCK_ERROR_NS:
        measured_ns = vehicle.heard_ns
    return min(measured_ns, now_ns)


def _index(leg: Sequence[PlannedSegment], position: VehiclePosition, now_ns: int) -> int | None:
    """Where on a leg a vehicle is; None: not on it. Of segments that it drives twice, the one that
    is due now.
    """
    found = [i for i, planned in enumerate(leg) if planned.segment == position.segment]
    return min(found, key=lambda i: abs(leg[i].entry_ns - now_ns), default=None)


def _visit(vehicle: TrackedVehicle, stop: str) -> Visit | None:
    visits = () if vehicle.progress is None else vehicle.progress.visits
    return next((visit for visit in reversed(visits) if visit.stop == stop), None)


def _committed(
    legs: Sequence[Sequence[PlannedSegment]],
    targets: Sequence[str],
    stops: Sequence[str],
    horizon_ns: float,
    at: int | None,
) -> list[CommittedLeg]:
    """The fixed part of the legs from the present one on.

    Args:
        legs: of the plan, the present one first.
        targets: the stops that they end at, without the depot.
        stops: those that are still to be served, in the same order.
        at: index of the segment in the first leg that the vehicle is on; None: it stands.
    """
    found: list[CommittedLeg] = []
    for number, leg in enumerate(legs):
        entered = sum(planned.entry_ns <= horizon_ns for planned in leg)
        if number == 0 and at is not None:
            begin, fixed = at, max(at + 1, entered) + 1
        else:
            begin, fixed = 0, entered + 1 if entered else 0
        if number > 0 and not fixed:
            break
        path = tuple(planned.segment for planned in leg[begin:fixed])
        target = targets[number] if number < len(targets) else None
        goal = stops[number] if number < len(stops) else None
        complete = bool(path) and begin + len(path) == len(leg) and target == goal
        found.append(CommittedLeg(path, complete))
        if not complete or target is None:
            break
    return found

"""Candidate arcs over the roads, predicted entry times, and the timetable of finished routes."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from dispatcher_daemon.fleet import Break, Vehicle
from dispatcher_daemon.forms import RoutingProblem
from slipstream.energy.drive import Drive


@dataclass(frozen=True)
class Charging:
    """What a vehicle takes in at a charging stop."""

    energy_kwh: float
    duration_s: float


@dataclass(frozen=True)
class RoadLeg:
    """The path between two places (stops or the depot).

    Attributes:
        cost_kwh: expected energy and the price of its time, or what else the search minimises.
        beyond_kwh: expected energy beyond that of the drive, because of traffic and signals.
        charging: at its end; None: none.
        pause: break that is taken at its end, which is the place of its begin; None: none.
    """

    start: str
    end: str
    path: tuple[str, ...]
    cost_kwh: float
    drive: Drive
    beyond_kwh: float = 0.0
    charging: Charging | None = None
    pause: Break | None = None


@dataclass(frozen=True)
class RoutedArc:
    """A candidate arc with its path and its predicted times.

    Attributes:
        vehicle: k.
        leg: the path from i to j.
        depart_s: predicted departure from i, s after the cycle's reference time.
        exact: True if no choice of route can change that departure.
    """

    vehicle: str
    leg: RoadLeg
    depart_s: float
    exact: bool

    def entries_s(self) -> dict[str, float]:
        """Predicted entry time t̂_{e,k} into each segment under the arc."""
        return {
            segment: self.depart_s + entry
            for segment, entry in zip(self.leg.path, self.leg.drive.entry_s, strict=True)
        }

    def leavings_s(self) -> dict[str, float]:
        """Predicted time of leaving each segment under the arc."""
        ends = (*self.leg.drive.entry_s[1:], self.leg.drive.duration_s)
        return {
            segment: self.depart_s + end for segment, end in zip(self.leg.path, ends, strict=True)
        }


@dataclass(frozen=True)
class StopVisit:
    """Arrival at and departure from a place, s after the reference time.

    Attributes:
        wait_s: for other vehicles, after service and before the departure.
    """

    place: str
    arrival_s: float
    departure_s: float
    wait_s: float = 0.0


@dataclass(frozen=True)
class Route:
    """A vehicle's finished route: depot, stops, depot, with its exact timetable."""

    vehicle: str
    visits: tuple[StopVisit, ...]
    legs: tuple[RoadLeg, ...]

    def entries_s(self) -> list[tuple[int, int, str, float, float]]:
        """(leg, position in it, segment, entry, exit) of all segments, s, in driving order."""
        entries = []
        for number, (leg, visit) in enumerate(zip(self.legs, self.visits, strict=False)):
            times = [*leg.drive.entry_s, leg.drive.duration_s]
            for position, segment in enumerate(leg.path):
                begin, end = times[position], times[position + 1]
                entries.append(
                    (number, position, segment, visit.departure_s + begin, visit.departure_s + end)
                )
        return entries


def candidate_arcs(
    problem: RoutingProblem, legs: Mapping[tuple[str, str], RoadLeg], reference_s: float = 0.0
) -> tuple[RoutedArc, ...]:
    """All candidate arcs with predicted departures, vehicle by vehicle.

    The departure from a stop depends on the stops before it, which are not chosen yet (FINDINGS,
    "The paper", 2). The earliest one is predicted; it is exact for arcs from the depot and wherever
    every stop before it has only one possible predecessor.
    """
    arcs = []
    for vehicle in problem.fleet.vehicles:
        pairs = [pair for pair in problem.fleet.legs(vehicle) if pair in legs]
        departures = _earliest_departures(problem, vehicle, pairs, legs, reference_s)
        arcs += [
            RoutedArc(vehicle.id, legs[pair], *departures[pair[0]])
            for pair in pairs
            if pair[0] in departures
        ]
    return tuple(arcs)


def _earliest_departures(
    problem: RoutingProblem,
    vehicle: Vehicle,
    pairs: Sequence[tuple[str, str]],
    legs: Mapping[tuple[str, str], RoadLeg],
    reference_s: float,
) -> dict[str, tuple[float, bool]]:
    fleet, depot = problem.fleet, problem.fleet.depot_of(vehicle).id
    before: dict[str, list[str]] = {}
    for start, end in pairs:
        before.setdefault(end, []).append(start)

    earliest: dict[str, float] = {}
    queue = [(reference_s + vehicle.ready_s, depot)]
    while queue:
        time, place = heapq.heappop(queue)
        if place in earliest:
            continue
        earliest[place] = time
        for start, end in pairs:
            if start == place and end != depot:
                arrival = time + legs[start, end].drive.duration_s
                heapq.heappush(queue, (arrival + fleet.service_s(end), end))

    def is_exact(place: str) -> bool:
        seen = set()
        while place != depot and place not in seen:
            seen.add(place)
            if len(before[place]) != 1:
                return False
            place = before[place][0]
        return True

    return {place: (time, is_exact(place)) for place, time in earliest.items()}


def empty_leg(start: str, end: str) -> RoadLeg:
    """The leg between two places at one junction: no segment, no time."""
    return RoadLeg(start, end, (), 0.0, Drive((0.0,), (0.0,), (), 0.0))


def timetable(
    problem: RoutingProblem,
    legs: Mapping[tuple[str, str], RoadLeg],
    vehicle: Vehicle,
    stops: Sequence[str],
    reference_s: float = 0.0,
    depart_s: float | None = None,
) -> Route:
    """Exact times of one vehicle's route over its stops in order.

    A vehicle that comes before a stop's window opens waits for it; see `lateness_s` for windows
    that are missed.

    Args:
        reference_s: when a vehicle that is ready at once leaves.
        depart_s: when this one leaves; None: as soon as it is ready.
    """
    depot = problem.fleet.depot_of(vehicle).id
    own = [legs[pair] for pair in pairwise((depot, *stops, depot))]
    return timed(problem, own, vehicle, reference_s, depart_s)


def timed(
    problem: RoutingProblem,
    legs: Sequence[RoadLeg],
    vehicle: Vehicle,
    reference_s: float = 0.0,
    depart_s: float | None = None,
    waits_s: Sequence[float] = (),
) -> Route:
    """The same for given legs, from the vehicle's depot and back to it.

    Args:
        waits_s: for other vehicles, at the end of each leg but the last; none: nowhere.
    """
    fleet = problem.fleet
    clock = reference_s + vehicle.ready_s if depart_s is None else depart_s
    visits = [StopVisit(legs[0].start, clock, clock)]
    waits = [*waits_s, *([0.0] * (len(legs) - len(waits_s)))]
    for leg, wait_s in zip(legs, waits, strict=True):
        arrival = clock + leg.drive.duration_s
        stop = fleet.stop_by_id.get(leg.end)
        clock = arrival
        if stop is not None:
            clock = max(arrival, reference_s + stop.earliest_s) + stop.service_s
        if leg.charging is not None:
            clock += leg.charging.duration_s
        if leg.pause is not None:
            clock = max(clock, reference_s + leg.pause.earliest_s) + leg.pause.duration_s
        clock += wait_s
        visits.append(StopVisit(leg.end, arrival, clock, wait_s))
    return Route(vehicle.id, tuple(visits), tuple(legs))


def lateness_s(
    problem: RoutingProblem, vehicle: Vehicle, route: Route, reference_s: float = 0.0
) -> float:
    """By how much a route misses its worst window; 0 or less: it keeps them all.

    Windows are those of its stops (for the start of service), of its departure and its return.
    """
    return max(lateness_by_window_s(problem, vehicle, route, reference_s))


def lateness_by_window_s(
    problem: RoutingProblem,
    vehicle: Vehicle,
    route: Route,
    reference_s: float = 0.0,
    *,
    under_way: bool = False,
) -> list[float]:
    """By how much a route misses its windows: departure, return, stops; < 0: it keeps one.

    Args:
        under_way: its departure lies behind it.
    """
    leaves, back = route.visits[0].departure_s - reference_s, route.visits[-1].arrival_s
    latest = vehicle.ready_s if vehicle.depart_by_s is None else vehicle.depart_by_s
    late = [] if under_way else [leaves - latest, vehicle.ready_s - leaves]
    if vehicle.return_by_s is not None:
        late.append(back - reference_s - vehicle.return_by_s)
    for visit in route.visits[1:-1]:
        stop = problem.fleet.stop_by_id.get(visit.place)
        if stop is not None and stop.latest_s is not None:
            late.append(visit.arrival_s - reference_s - stop.latest_s)
    if vehicle.breaks and not under_way:
        late += _late_for_breaks_s(vehicle, route, reference_s)
    return late


def _late_for_breaks_s(vehicle: Vehicle, route: Route, reference_s: float) -> Iterator[float]:
    """By how much each break begins too late; by the whole tour where there is none for it."""
    legs = zip(route.legs, route.visits[1:], strict=True)
    taken = {leg.end: visit for leg, visit in legs if leg.pause is not None}
    leaves_s = route.visits[0].departure_s - reference_s
    back_s = route.visits[-1].arrival_s - reference_s
    at_depot = vehicle.breaks_at_depot(leaves_s, back_s)
    for number, own in enumerate(vehicle.breaks):
        visit = taken.get(vehicle.break_id(number))
        if visit is not None:
            begins_s = visit.departure_s - visit.wait_s - own.duration_s - reference_s
            yield begins_s - own.latest_s
        elif number not in at_depot:
            # It ends its window late by the whole of what it lacks, even where only a part of it
            # has no room beside the other breaks.
            yield max(back_s - own.latest_s, own.duration_s)

"""Stops put into tours one by one, each where it costs least; all others stay where they are."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

from dispatcher_daemon.fleet import Fleet, Stop, Vehicle
from dispatcher_daemon.planning.plans import Candidate, CandidateRefusal, Cycle
from dispatcher_daemon.planning.roads import fleet_travel, lateness_s, timed
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from slipstream.explain import InsertedStop, OfferedTour, TourObstacle

NAME: Final = "insertion"
NEAREST: Final = 6
"""Tours that a stop is tried in: those with the shortest detours in a straight line."""
MAX_STOPS: Final = 20
"""Stops that are put in at once: more of them are for a cycle."""
_ROUNDING_S: Final = 1e-6
_WAITS: Final = "it waits for the next cycle"
_COUNTED: Final[Mapping[TourObstacle, str]] = {
    "carrier": "of another carrier",
    "pinned": "not the vehicle that it is kept for",
    "skill": "without its skills",
    "capacity": "without room",
    "far": "farther away, not tried",
    "late": "late already",
    "loaded": "with a first stop that is not planned",
    "no_way": "without a way there and back",
    "charge": "without the charge",
    "window": "too late for a window of a stop",
    "shift": "back too late",
    "break": "too late for a break",
}


@dataclass(frozen=True)
class Insertion:
    """What became of stops that were to be put into tours.

    Attributes:
        found: verified plans of the vehicles whose tours have changed; None: none has.
        missing: why each of the other stops is in none.
        tried: the stops in turn, with the tours that were offered to each.
    """

    found: Candidate | None
    missing: Mapping[str, str]
    tried: tuple[InsertedStop, ...] = ()


def insert_stops(
    cycle: Cycle, routes: Mapping[str, Sequence[str]], wanted: Sequence[str]
) -> Insertion:
    """Put stops into tours.

    Args:
        cycle: its fleet has the vehicles of the tours, their stops, and those that are wanted.
    """
    fleet = cycle.problem.fleet
    late = f"more than {MAX_STOPS} came at once: {_WAITS}"
    missing = dict.fromkeys(wanted[MAX_STOPS:], late)
    wanted = wanted[:MAX_STOPS]
    unfit = {stop: _unfit(fleet, routes, fleet.stop_by_id[stop]) for stop in wanted}
    near = {v for stop in wanted for v in _nearest(cycle, routes, stop, unfit[stop])}
    planner, present = None, dict[int, Itinerary]()
    part = _part(fleet, near, {*wanted, *(stop for v in near for stop in routes[v])})
    problem = replace(cycle.problem, fleet=part)
    if near:
        travel = fleet_travel(problem, cycle.snapshot)
        window_s = cycle.settings.sync_window_s
        planner = Planner(problem, cycle.snapshot, [travel], window_s, cycle.reference_s)
        present = _present(planner, routes)
    changed: dict[int, Itinerary] = {}
    tried = []
    for stop in wanted:
        offers: dict[str, OfferedTour] = {}
        best: Itinerary | None = None
        for old in (present | changed).values() if planner is not None else ():
            assert planner is not None
            offer, new = _offer(planner, old, stop)
            offers[offer.vehicle] = offer
            known = None if best is None else offers[part.vehicles[best.number].id].cost_kwh
            if new is not None and (known is None or (offer.cost_kwh or 0.0) < known):
                best = new
        for vehicle in fleet.vehicles:
            name = vehicle.id
            if name not in offers:
                # A tour that has become late stays as it is.
                reason: TourObstacle = "late" if name in near else "far"
                offers[name] = OfferedTour(name, *unfit[stop].get(name, (reason, None)))
        ordered = tuple(offers[vehicle.id] for vehicle in fleet.vehicles)
        if best is None:
            missing[stop] = f"{_nowhere(ordered)}: {_WAITS}"
            tried.append(InsertedStop(stop, None, (), ordered))
        else:
            changed[best.number] = best
            tried.append(InsertedStop(stop, part.vehicles[best.number].id, best.stops, ordered))
    if not changed:
        return Insertion(None, missing, tuple(tried))
    planned = [changed[number] for number in sorted(changed)]
    names = {part.vehicles[number].id for number in changed}
    smaller = _part(part, names, {stop for itinerary in planned for stop in itinerary.stops})
    cycle = replace(cycle, problem=replace(problem, fleet=smaller))
    timetables = [itinerary.route for itinerary in planned if itinerary.route is not None]
    cost_kwh = math.fsum(itinerary.cost_kwh for itinerary in planned)
    result = cycle.candidate(NAME, timetables, cost_kwh, platooning=False)
    if isinstance(result, CandidateRefusal):
        why = f"its plan was refused: {result.reason}"
        refused = {s: why for i in planned for s in i.stops if s in set(wanted)}
        return Insertion(None, missing | refused, tuple(tried))
    return Insertion(result, missing, tuple(tried))


def cheapest_insertion(
    planner: Planner, itineraries: Sequence[Itinerary], stop: str
) -> Itinerary | None:
    """The cheapest insertion of a stop into a route that has room, time and charge for it."""
    best: tuple[float, Itinerary] | None = None
    for old in itineraries:
        new = cheapest_place(planner, old, stop)
        if new is not None and (best is None or new.cost_kwh - old.cost_kwh < best[0]):
            best = new.cost_kwh - old.cost_kwh, new
    return None if best is None else best[1]


def cheapest_place(planner: Planner, old: Itinerary, stop: str) -> Itinerary | None:
    """The cheapest insertion of a stop into one route; None: there is none."""
    fleet = planner.problem.fleet
    vehicle, wanted = fleet.vehicles[old.number], fleet.stop_by_id[stop]
    if old.route is None and vehicle.first_stop is not None:
        return None
    served = [fleet.stop_by_id[name] for name in (*old.stops, stop)]
    if not fleet.may_serve(vehicle, wanted) or fleet.overload(vehicle, served) is not None:
        return None
    best: Itinerary | None = None
    for tried in _places(vehicle, old.stops, stop):
        new = planner.itinerary(old.number, tried, planner.legs(old.number, tried))
        if new is not None and (best is None or new.cost_kwh < best.cost_kwh):
            best = new
    return best


def _places(vehicle: Vehicle, stops: Sequence[str], stop: str) -> list[tuple[str, ...]]:
    """A route with a stop at each of its places, behind what is loaded."""
    first = 0 if vehicle.first_stop is None else 1
    return [(*stops[:at], stop, *stops[at:]) for at in range(first, len(stops) + 1)]


def _offer(planner: Planner, old: Itinerary, stop: str) -> tuple[OfferedTour, Itinerary | None]:
    """What a tour has for a stop, and the tour with it."""
    fleet = planner.problem.fleet
    vehicle = fleet.vehicles[old.number]
    new = cheapest_place(planner, old, stop)
    if new is not None:
        cost_kwh = new.cost_kwh - old.cost_kwh
        return OfferedTour(vehicle.id, None, None, cost_kwh, new.stops), new
    served = [fleet.stop_by_id[name] for name in old.stops]
    unfit = _obstacle(fleet, vehicle, served, fleet.stop_by_id[stop])
    if unfit is None and old.route is None and vehicle.first_stop is not None:
        unfit = "loaded", vehicle.first_stop
    return OfferedTour(vehicle.id, *(unfit or _no_time(planner, old, stop))), None


def _no_time(planner: Planner, old: Itinerary, stop: str) -> tuple[TourObstacle, str]:
    """Why no place of a tour has way, charge or time for a stop: of the nearest place."""
    problem, number = planner.problem, old.number
    vehicle = problem.fleet.vehicles[number]
    own = planner.travels[0].of(vehicle)
    depot, nearest = problem.fleet.depot_of(vehicle).id, None
    has_way = False
    for tried in _places(vehicle, old.stops, stop):
        places = (depot, *tried, depot)
        has_way = has_way or all(own.leg(a, b) is not None for a, b in pairwise(places))
        legs = planner.legs(number, tried)
        if legs is None or not planner.lasts(number, legs):
            continue
        begins_s = planner.ready_after_charging_s(number, legs)
        route = timed(problem, legs, vehicle, planner.windows.reference_s, begins_s)
        late_s = lateness_s(problem, vehicle, route, planner.windows.reference_s)
        if nearest is None or late_s < nearest[0]:
            nearest = late_s, route
    if nearest is None:
        if not has_way:
            return "no_way", f"{problem.fleet.node(stop)!r} cannot be reached or left again"
        return "charge", "its battery does not last, with no charging stop in reach"
    late_s, route = nearest
    reference_s = planner.windows.reference_s
    behind_s = route.visits[0].departure_s - planner.windows.of(number)[1]
    if behind_s > _ROUNDING_S:
        return "charge", f"it would leave {behind_s:.0f} s too late, as it has to charge before"
    for visit in route.visits[1:-1]:
        served = problem.fleet.stop_by_id.get(visit.place)
        latest_s = None if served is None else served.latest_s
        if latest_s is not None and visit.arrival_s - reference_s > latest_s:
            by_s = visit.arrival_s - reference_s - latest_s
            return "window", f"at {visit.place} {by_s:.0f} s after its window has closed"
    back_s = route.visits[-1].arrival_s - reference_s
    if vehicle.return_by_s is not None and back_s > vehicle.return_by_s:
        return "shift", f"back {back_s - vehicle.return_by_s:.0f} s after the end of its shift"
    if vehicle.breaks:
        return "break", f"a break of its own would begin {late_s:.0f} s too late"
    return "window", f"{late_s:.0f} s too late to leave"


def _present(planner: Planner, routes: Mapping[str, Sequence[str]]) -> dict[int, Itinerary]:
    """The tours as they are, by number, but for those that have become late."""
    found = {}
    for number, vehicle in enumerate(planner.problem.fleet.vehicles):
        stops = tuple(routes[vehicle.id])
        own = planner.itinerary(number, stops, planner.legs(number, stops) if stops else None)
        if own is not None:
            found[number] = own
    return found


def _obstacle(
    fleet: Fleet, vehicle: Vehicle, served: Sequence[Stop], wanted: Stop
) -> tuple[TourObstacle, str] | None:
    """Why a vehicle may not serve a stop, or not carry it; None: it may."""
    if wanted.carrier not in (None, vehicle.carrier):
        return "carrier", f"of another carrier than {wanted.carrier}"
    if wanted.vehicle not in (None, vehicle.id):
        return "pinned", f"it is kept for {wanted.vehicle}"
    lacking = [skill for skill in wanted.skills if skill not in vehicle.skills]
    if lacking:
        return "skill", f"it has no skill {', '.join(lacking)}"
    overload = fleet.overload(vehicle, [*served, wanted])
    return None if overload is None else ("capacity", f"its load would be {overload}")


def _unfit(
    fleet: Fleet, routes: Mapping[str, Sequence[str]], wanted: Stop
) -> dict[str, tuple[TourObstacle, str]]:
    found = {}
    for vehicle in fleet.vehicles:
        served = [fleet.stop_by_id[name] for name in routes[vehicle.id]]
        obstacle = _obstacle(fleet, vehicle, served, wanted)
        if obstacle is not None:
            found[vehicle.id] = obstacle
    return found


def _nowhere(offers: Sequence[OfferedTour]) -> str:
    counts = Counter(offer.obstacle for offer in offers if offer.obstacle is not None)
    some = ", ".join(f"{n} {_COUNTED[obstacle]}" for obstacle, n in counts.most_common())
    reason = "no tour that has not begun may take it, or has room and time for it"
    return f"{reason} ({some})" if some else reason


def _nearest(
    cycle: Cycle, routes: Mapping[str, Sequence[str]], stop: str, unfit: Mapping[str, object]
) -> list[str]:
    """The vehicles that may serve a stop, and carry it, with the shortest detours."""
    fleet, at = cycle.problem.fleet, cycle.problem.network.junctions
    there = at[fleet.node(stop)]
    found = []
    for vehicle in fleet.vehicles:
        if vehicle.id in unfit:
            continue
        home = fleet.depot_of(vehicle).node
        nodes = (home, *(fleet.node(name) for name in routes[vehicle.id]), home)
        detours = (
            math.dist(a, there) + math.dist(there, b) - math.dist(a, b)
            for a, b in pairwise(at[node] for node in nodes)
        )
        found.append((min(detours), vehicle.id))
    return [name for _, name in sorted(found)[:NEAREST]]


def _part(fleet: Fleet, vehicles: set[str], stops: set[str]) -> Fleet:
    kept = {
        "vehicles": tuple(v for v in fleet.vehicles if v.id in vehicles),
        "stops": tuple(stop for stop in fleet.stops if stop.id in stops),
    }
    return Fleet.model_construct(**fleet.parts | kept)

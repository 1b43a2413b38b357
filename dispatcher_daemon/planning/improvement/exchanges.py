"""Relocate and swap moves of stops between two vehicles of a block, as options."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations

import networkx as nx
import numpy as np

from dispatcher_daemon.planning.improvement.departures import best_departure
from dispatcher_daemon.planning.platooning import Meetings
from dispatcher_daemon.planning.roads import Travel
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner

EVALUATIONS_PER_EXCHANGE = 4
"""Exchanges that are evaluated exactly for each one that is returned."""
MAX_DEPARTURES = 2
"""Departures that are evaluated besides leaving when ready."""

Pair = tuple[tuple[int, tuple[str, ...]], tuple[int, tuple[str, ...]]]


def best_exchanges(
    planner: Planner,
    itineraries: Sequence[Itinerary],
    meetings: Meetings,
    max_exchanges: int,
    rng: np.random.Generator,
) -> list[tuple[Itinerary, Itinerary]]:
    """The best exchanges between two vehicles with all others unchanged. They may cost more than
    they save, as other vehicles of the block may change too.

    Args:
        itineraries: of the block's vehicles, on ``meetings`` as they are.

    Returns:
        Both vehicles' itineraries of each exchange, the best first.
    """
    tried = max_exchanges * EVALUATIONS_PER_EXCHANGE
    moves = sorted(_moves(planner, itineraries), key=lambda move: move[0])[: 3 * tried]
    if not moves:
        return []
    # The cheapest, and some others that are nearly as cheap.
    drawn = [0, *(1 + rng.permutation(len(moves) - 1)[: tried - 1])]
    present = {i.number: i for i in itineraries}
    found: list[tuple[float, tuple[Itinerary, Itinerary]]] = []
    for number in drawn:
        _, (one, other) = moves[number]
        old = present[one[0]], present[other[0]]
        new: list[Itinerary] = []
        with meetings.tried():
            change = -sum(meetings.remove(i.traversals) + i.cost_kwh for i in old)
            for vehicle, stops in (one, other):
                itinerary = _timed(planner, vehicle, stops, meetings)
                if itinerary is None:
                    break
                change += itinerary.cost_kwh - meetings.add(itinerary.traversals)
                new.append(itinerary)
        if len(new) == 2:
            found.append((change, (new[0], new[1])))
    return [pair for _, pair in sorted(found, key=lambda entry: entry[0])[:max_exchanges]]


def exchanged(
    itineraries: Sequence[Itinerary], stops: Mapping[int, tuple[str, ...]]
) -> list[list[int]]:
    """Smallest groups of vehicles among which other routes serve the same stops differently.

    Args:
        stops: of the other routes, by vehicle number.
    """
    owner = {stop: i.number for i in itineraries for stop in i.stops}
    graph = nx.Graph()
    for i in itineraries:
        if stops[i.number] != i.stops:
            graph.add_node(i.number)
            graph.add_edges_from((i.number, owner[stop]) for stop in stops[i.number])
    return sorted(sorted(group) for group in nx.connected_components(graph))


class _Vehicles:
    """What moves of stops between some vehicles cost, and which are allowed, as tables."""

    def __init__(self, planner: Planner, itineraries: Sequence[Itinerary]) -> None:
        fleet = planner.problem.fleet
        vehicles = {i.number: fleet.vehicles[i.number] for i in itineraries}
        stops = {name: fleet.stop_by_id[name] for i in itineraries for name in i.stops}
        depot = {n: fleet.depot_of(vehicle).id for n, vehicle in vehicles.items()}
        places = list(dict.fromkeys((*depot.values(), *stops)))
        rows = [planner.travels[0].row[place] for place in places]
        self._column = {place: at for at, place in enumerate(places)}
        self._depot = {n: self._column[name] for n, name in depot.items()}
        by_profile: dict[Travel, list[list[float]]] = {
            travel: travel.search_cost_kwh[np.ix_(rows, rows)].tolist()
            for travel in {planner.travels[0].of(vehicle) for vehicle in vehicles.values()}
        }
        self._cost_kwh = {n: by_profile[planner.travels[0].of(v)] for n, v in vehicles.items()}
        self._limits = {n: fleet.limits(vehicle) for n, vehicle in vehicles.items()}
        self._demand = {name: stop.demand for name, stop in stops.items()}
        self._mass_kg = {name: stop.mass_kg for name, stop in stops.items()}
        self._served = {
            n: frozenset(name for name, stop in stops.items() if fleet.may_serve(vehicle, stop))
            for n, vehicle in vehicles.items()
        }

    def cost_kwh(self, number: int, stops: Sequence[str]) -> float:
        """Of a route over some stops; nothing without any."""
        if not stops:
            return 0.0
        cost_kwh, column = self._cost_kwh[number], self._column
        at = depot = self._depot[number]
        total = 0.0
        for stop in stops:
            before, at = at, column[stop]
            total += cost_kwh[before][at]
        return total + cost_kwh[at][depot]

    def fits(self, number: int, stops: Sequence[str]) -> bool:
        units, kg = self._limits[number]
        return (
            self._served[number].issuperset(stops)
            and sum([self._demand[stop] for stop in stops]) <= units
            and (kg == math.inf or math.fsum(self._mass_kg[stop] for stop in stops) <= kg)
        )


def _moves(planner: Planner, itineraries: Sequence[Itinerary]) -> Iterator[tuple[float, Pair]]:
    """(change of cost, new stops of both): each stop moved to each place of another route, and
    each swap of two stops; loads and first stops kept, and each stop with who may serve it.
    """
    of = _Vehicles(planner, itineraries)
    cost = {i.number: of.cost_kwh(i.number, i.stops) for i in itineraries}
    carriers = {i.number: planner.problem.fleet.vehicles[i.number].carrier for i in itineraries}
    for one, other in permutations(itineraries, 2):
        if carriers[one.number] != carriers[other.number]:
            continue
        before = cost[one.number] + cost[other.number]
        for at in range(_fixed(planner, one), len(one.stops)):
            stop, shorter = one.stops[at], one.stops[:at] + one.stops[at + 1 :]
            # Whether stops fit does not depend on their order.
            fits = of.fits(other.number, (*other.stops, stop))
            less = of.cost_kwh(one.number, shorter) - before
            for place in range(_fixed(planner, other), len(other.stops) + 1):
                if fits:
                    longer = (*other.stops[:place], stop, *other.stops[place:])
                    change = less + of.cost_kwh(other.number, longer)
                    if math.isfinite(change):
                        yield change, ((one.number, shorter), (other.number, longer))
                if one.number < other.number and place < len(other.stops):
                    swapped = (*one.stops[:at], other.stops[place], *one.stops[at + 1 :])
                    theirs = (*other.stops[:place], stop, *other.stops[place + 1 :])
                    if of.fits(one.number, swapped) and of.fits(other.number, theirs):
                        change = of.cost_kwh(one.number, swapped)
                        change += of.cost_kwh(other.number, theirs)
                        change -= before
                        if math.isfinite(change):
                            yield change, ((one.number, swapped), (other.number, theirs))


def _fixed(planner: Planner, itinerary: Itinerary) -> int:
    """How many stops at the beginning have to stay: a first stop is loaded."""
    return 0 if planner.problem.fleet.vehicles[itinerary.number].first_stop is None else 1


def _timed(
    planner: Planner, number: int, stops: tuple[str, ...], meetings: Meetings
) -> Itinerary | None:
    """The itinerary at the departure that saves most with those on the road."""
    earliest = planner.itinerary(number, stops, planner.legs(number, stops))
    return None if earliest is None else best_departure(planner, earliest, meetings, MAX_DEPARTURES)

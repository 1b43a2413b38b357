"""Relocate and swap moves of stops between two vehicles of a block, as options."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, permutations

import networkx as nx
import numpy as np

from dispatcher_daemon.planning.departures import best_departure
from dispatcher_daemon.planning.itineraries import Itinerary, Planner
from dispatcher_daemon.platooning import Meetings

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
        max_exchanges: exchanges to return.
        rng: draws which of the cheap exchanges are tried.

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
        change = -sum(meetings.remove(i.traversals) + i.cost_kwh for i in old)
        new: list[Itinerary] = []
        for vehicle, stops in (one, other):
            itinerary = _timed(planner, vehicle, stops, meetings)
            if itinerary is None:
                break
            change += itinerary.cost_kwh - meetings.add(itinerary.traversals)
            new.append(itinerary)
        for itinerary in new:
            meetings.remove(itinerary.traversals)
        for itinerary in old:
            meetings.add(itinerary.traversals)
        if len(new) == 2:
            found.append((change, (new[0], new[1])))
    return [pair for _, pair in sorted(found, key=lambda entry: entry[0])[:max_exchanges]]


def exchanged(
    itineraries: Sequence[Itinerary], stops: Mapping[int, tuple[str, ...]]
) -> list[list[int]]:
    """Smallest groups of vehicles among which other routes serve the same stops differently.

    Args:
        itineraries: of all vehicles.
        stops: of the other routes, by vehicle number.
    """
    owner = {stop: i.number for i in itineraries for stop in i.stops}
    graph = nx.Graph()
    for i in itineraries:
        if stops[i.number] != i.stops:
            graph.add_node(i.number)
            graph.add_edges_from((i.number, owner[stop]) for stop in stops[i.number])
    return sorted(sorted(group) for group in nx.connected_components(graph))


def _moves(planner: Planner, itineraries: Sequence[Itinerary]) -> Iterator[tuple[float, Pair]]:
    """(change of cost, new stops of both): each stop moved to each place of another route, and
    each swap of two stops; loads and first stops kept, and each stop with who may serve it.
    """
    cost = {i.number: _cost(planner, i.number, i.stops) for i in itineraries}
    carriers = {i.number: planner.problem.fleet.vehicles[i.number].carrier for i in itineraries}
    for one, other in permutations(itineraries, 2):
        if carriers[one.number] != carriers[other.number]:
            continue
        before = cost[one.number] + cost[other.number]
        for at in range(_fixed(planner, one), len(one.stops)):
            stop, shorter = one.stops[at], one.stops[:at] + one.stops[at + 1 :]
            # Whether stops fit does not depend on their order.
            fits = _fits(planner, other.number, (*other.stops, stop))
            less = _cost(planner, one.number, shorter) - before
            for place in range(_fixed(planner, other), len(other.stops) + 1):
                if fits:
                    longer = (*other.stops[:place], stop, *other.stops[place:])
                    change = less + _cost(planner, other.number, longer)
                    if np.isfinite(change):
                        yield change, ((one.number, shorter), (other.number, longer))
                if one.number < other.number and place < len(other.stops):
                    swapped = (*one.stops[:at], other.stops[place], *one.stops[at + 1 :])
                    theirs = (*other.stops[:place], stop, *other.stops[place + 1 :])
                    yield from _swap(planner, before, (one.number, swapped), (other.number, theirs))


def _swap(
    planner: Planner,
    before: float,
    one: tuple[int, tuple[str, ...]],
    other: tuple[int, tuple[str, ...]],
) -> Iterator[tuple[float, Pair]]:
    if _fits(planner, *one) and _fits(planner, *other):
        change = _cost(planner, *one) + _cost(planner, *other) - before
        if np.isfinite(change):
            yield change, (one, other)


def _cost(planner: Planner, number: int, stops: tuple[str, ...]) -> float:
    if not stops:
        return 0.0
    fleet = planner.problem.fleet
    travel = planner.travels[0].of(fleet.vehicles[number])
    depot = fleet.depot_of(fleet.vehicles[number]).id
    rows = [travel.row[place] for place in (depot, *stops, depot)]
    return float(sum(travel.search_cost_kwh[a, b] for a, b in pairwise(rows)))


def _fits(planner: Planner, number: int, stops: tuple[str, ...]) -> bool:
    fleet = planner.problem.fleet
    vehicle, served = fleet.vehicles[number], [fleet.stop_by_id[s] for s in stops]
    if not all(fleet.may_serve(vehicle, stop) for stop in served):
        return False
    return fleet.overload(vehicle, served) is None


def _fixed(planner: Planner, itinerary: Itinerary) -> int:
    """How many stops at the beginning have to stay: a first stop is loaded."""
    return 0 if planner.problem.fleet.vehicles[itinerary.number].first_stop is None else 1


def _timed(
    planner: Planner, number: int, stops: tuple[str, ...], meetings: Meetings
) -> Itinerary | None:
    """The itinerary at the departure that saves most with those on the road."""
    earliest = planner.itinerary(number, stops, planner.legs(number, stops))
    return None if earliest is None else best_departure(planner, earliest, meetings, MAX_DEPARTURES)

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.improvement.exchanges import best_exchanges
from dispatcher_daemon.planning.improvement.sweeps import choice_of
from dispatcher_daemon.planning.platooning.meetings import Meetings
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
CORNERS = ["33", "03", "32", "02"]
"""The first two lie far from each other, as do the last two."""


def plan(
    town: Town, routes: list[list[str]], vans: list[dict[str, object]], loads: list[int]
) -> tuple[Planner, list[Itinerary], Meetings]:
    """Vans on given routes over stops at the corners."""
    stops = [
        {"id": f"s{i}", "node": node, "service_s": 20.0, "demand": load}
        for i, (node, load) in enumerate(zip(CORNERS, loads, strict=True))
    ]
    problem, snapshot = town(stops, vans, seed=2)
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0)
    meetings, present = Meetings(planner.book.shares, 3.0, planner.book.longest), []
    for n, route in enumerate(routes):
        itinerary = planner.itinerary(n, tuple(route), planner.legs(n, route))
        assert itinerary is not None
        meetings.add(itinerary.traversals)
        present.append(itinerary)
    return planner, present, meetings


CROSSED = [["s0", "s1"], ["s2", "s3"]]
FREE: list[dict[str, object]] = [{"depart_by_s": 60.0}, {"depart_by_s": 60.0}]


def test_crossed_routes_are_disentangled(town: Town) -> None:
    """Two vans that both drive to both corners swap stops, which shortens both ways; everybody is
    still served once, and the road is left as it was.
    """
    planner, present, meetings = plan(town, CROSSED, FREE, [0, 0, 0, 0])
    before = {s: list(meetings.on(s)) for s in planner.book.shares}
    (best, *_) = best_exchanges(planner, present, meetings, 3, np.random.default_rng(1))
    assert {best[0].number, best[1].number} == {0, 1}
    assert sorted(best[0].stops + best[1].stops) == ["s0", "s1", "s2", "s3"]
    now = choice_of(planner, sorted(best, key=lambda i: i.number)).objective_kwh
    assert now < choice_of(planner, present).objective_kwh - 0.01
    assert {s: list(meetings.on(s)) for s in planner.book.shares} == before


def test_nobody_is_overloaded(town: Town) -> None:
    """With vans that are full, only swaps of like loads are left."""
    vans: list[dict[str, object]] = [{"capacity": 5}, {"capacity": 5}]
    planner, present, meetings = plan(town, CROSSED, vans, [3, 2, 3, 2])
    found = best_exchanges(planner, present, meetings, 20, np.random.default_rng(1))
    assert found
    load = {"s0": 3, "s1": 2, "s2": 3, "s3": 2}
    for pair in found:
        assert all(sum(load[s] for s in i.stops) <= 5 for i in pair)


def test_loaded_parcels_stay_where_they_are(town: Town) -> None:
    """A first stop is neither given away nor preceded by another."""
    vans: list[dict[str, object]] = [{"first_stop": "s0"}, {"first_stop": "s2"}]
    planner, present, meetings = plan(town, CROSSED, vans, [0, 0, 0, 0])
    found = best_exchanges(planner, present, meetings, 20, np.random.default_rng(1))
    assert found
    for pair in found:
        for itinerary in pair:
            assert itinerary.stops[0] == ("s0", "s2")[itinerary.number]


def test_windows_are_kept(town: Town) -> None:
    """A van that has to be back when it is now is not sent on a longer way."""
    free, present, anywhere = plan(town, CROSSED, [{}, {}], [0, 0, 0, 0])
    every = best_exchanges(free, present, anywhere, 20, np.random.default_rng(1))
    assert present[1].route is not None
    limit_s = present[1].route.visits[-1].arrival_s + 1.0
    vans: list[dict[str, object]] = [{}, {"return_by_s": limit_s}]
    planner, present, meetings = plan(town, CROSSED, vans, [0, 0, 0, 0])
    found = best_exchanges(planner, present, meetings, 20, np.random.default_rng(1))
    assert 0 < len(found) < len(every)
    for itinerary in (i for pair in found for i in pair if i.number == 1):
        assert itinerary.route is None or itinerary.route.visits[-1].arrival_s <= limit_s

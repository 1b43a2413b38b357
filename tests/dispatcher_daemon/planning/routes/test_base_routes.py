from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import groupby, pairwise, permutations, product
from typing import Any

import pytest

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.routes import RoadLeg, lateness_s, timed
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.routes.base_routes import BaseRoutes, base_routes
from dispatcher_daemon.planning.routes.parts import FleetPart, parts_of_stops
from dispatcher_daemon.planning.routes.pyvrp_search import SearchAttempt, low_penalties
from dispatcher_daemon.settings import SearchSettings
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream_lab.research.cities.generator import CityShape, generate_city

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
Routes = Mapping[str, Sequence[str]]
SHORT = SearchSettings(rounds=2, iterations_per_stop=20, workers=1, time_limit_s=30.0)


class Broken(Executor):
    """Fails all jobs, either at once or when they are asked for."""

    def __init__(self, *, on_submit: bool) -> None:
        self._on_submit = on_submit

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """No job is done."""
        if self._on_submit:
            raise RuntimeError("no workers")
        future: Future[Any] = Future()
        future.set_exception(OSError("killed"))
        return future


class Silent(Executor):
    """Answers no job: its worker was killed as it took it on."""

    def __init__(self) -> None:
        self.asked: list[Future[Any]] = []

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """No job is done."""
        self.asked.append(Future())
        return self.asked[-1]


class Watched(ThreadPoolExecutor):
    """Does all jobs in one thread, and keeps their attempts."""

    def __init__(self) -> None:
        super().__init__(1)
        self.attempts: list[SearchAttempt] = []

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As a thread does it."""
        self.attempts += args[0].attempts
        return super().submit(fn, *args, **kwargs)


def travel_of(made: tuple[RoutingProblem, TrafficSnapshot]) -> Travel:
    """Ways of least energy."""
    return Travel(made[0], roads_of(*made))


def routed(
    made: tuple[RoutingProblem, TrafficSnapshot],
    settings: SearchSettings = SHORT,
    *,
    seed: int = 1,
    start: Routes | None = None,
    executor: Executor | None = None,
) -> BaseRoutes:
    """Base routes over all stops."""
    problem = made[0]
    names = [stop.id for stop in problem.fleet.stops]
    if executor is not None:
        return base_routes(problem, travel_of(made), names, settings, executor, seed, start)
    with ThreadPoolExecutor(1) as thread:
        return base_routes(problem, travel_of(made), names, settings, thread, seed, start)


def cost_kwh(made: tuple[RoutingProblem, TrafficSnapshot], routes: Routes) -> float:
    """Energy of routes that are sound: every van keeps its capacity and its windows, from and to
    its own depot, with what is loaded first; else inf.
    """
    problem, travel = made[0], travel_of(made)
    total = 0.0
    for vehicle in problem.fleet.vehicles:
        stops = routes[vehicle.id]
        if not stops:
            continue
        depot = problem.fleet.depot_of(vehicle).id
        legs: list[RoadLeg] = []
        for start, end in pairwise((depot, *stops, depot)):
            leg = travel.leg(start, end)
            if leg is None:
                return float("inf")
            legs.append(leg)
        load = sum(problem.fleet.stop_by_id[s].demand for s in stops)
        late_s = lateness_s(problem, vehicle, timed(problem, legs, vehicle))
        if (vehicle.capacity is not None and load > vehicle.capacity) or late_s > 1e-6:
            return float("inf")
        if vehicle.first_stop not in (None, stops[0]):
            return float("inf")
        total += sum(leg.cost_kwh for leg in legs)
    return total


def served(found: BaseRoutes) -> list[str]:
    """All stops on routes, in order of their names."""
    return sorted(stop for stops in found.stops.values() for stop in stops)


def parcel(name: str, node: str, **more: Any) -> dict[str, Any]:
    """A stop of demand 1."""
    return {"id": name, "node": node, "service_s": 20.0, "demand": 1, **more}


def best_by_trying_all(made: tuple[RoutingProblem, TrafficSnapshot]) -> float:
    """The least cost over all ways to serve all stops."""
    fleet = made[0].fleet
    names = [stop.id for stop in fleet.stops]
    least = float("inf")
    for owner in product([v.id for v in fleet.vehicles], repeat=len(names)):
        given = {
            v.id: [s for s, o in zip(names, owner, strict=True) if o == v.id]
            for v in fleet.vehicles
        }
        for orders in product(*(permutations(stops) for stops in given.values())):
            least = min(least, cost_kwh(made, dict(zip(given, orders, strict=True))))
    return least


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_tiny_fleet_gets_its_optimum(town: Town, seed: int) -> None:
    """Five parcels, two vans of two depots that cannot take more than three, one window and one
    parcel loaded already: no valid plan is cheaper than what is found.
    """
    stops = [parcel(f"p{i}", node) for i, node in enumerate(("33", "03", "31", "12"))]
    stops.append(parcel("early", "22", latest_s=120.0 + 20.0 * seed))
    vans = [
        {"capacity": 3, "depot": "depot-0", "first_stop": "p1"},
        {"capacity": 3, "depot": "depot-1"},
    ]
    made = town(stops, vans, ("00", "30"), seed=seed)
    found = routed(made)
    assert found.unassigned == ()
    assert served(found) == sorted(stop["id"] for stop in stops)
    assert cost_kwh(made, found.stops) == pytest.approx(best_by_trying_all(made), abs=1e-5)


@pytest.mark.slow
def test_every_load_and_window_of_a_city_is_kept() -> None:
    """A city with two depots, loads and windows, searched in parts: every stop once, none late,
    no van above its capacity; more rounds cost no more.
    """
    city = generate_city(
        5,
        vehicles=8,
        stops=36,
        segments=200,
        shape=CityShape(window_share=0.4, capacity_ratio=1.15),
    )
    made = city.problem, city.snapshot
    short = SHORT.model_copy(update={"part_stops": 10})
    found = routed(made, short)
    assert found.unassigned == ()
    assert not found.timed_out
    assert served(found) == sorted(stop.id for stop in city.problem.fleet.stops)
    first = routed(made, short.model_copy(update={"rounds": 0}))
    assert cost_kwh(made, found.stops) < cost_kwh(made, first.stops) < float("inf")
    assert routed(made, short).stops == found.stops


@pytest.mark.slow
@pytest.mark.parametrize("start", [False, True])
def test_first_routes_of_a_large_city_are_searched_in_parts(
    monkeypatch: pytest.MonkeyPatch, start: bool
) -> None:
    """Every stop once, all loads and windows kept, from nothing and from routes of the last cycle
    in which a stop is new and one is gone; the same again for the same seed.
    """
    monkeypatch.setattr(
        sys.modules["dispatcher_daemon.planning.routes.base_routes"], "_WHOLE_STOPS", 20
    )
    city = generate_city(3, vehicles=16, stops=60, segments=200)
    made = city.problem, city.snapshot
    short = SHORT.model_copy(update={"part_stops": 10, "rounds": 0})
    known = None
    if start:
        known = {v: [*s[1:], "gone"] for v, s in routed(made, short).stops.items()}
    found = routed(made, short, start=known)
    assert routed(made, short, start=known).stops == found.stops
    more = routed(made, short.model_copy(update={"rounds": 2}), start=known)
    assert more.unassigned == ()
    assert served(more) == sorted(stop.id for stop in city.problem.fleet.stops)
    assert cost_kwh(made, more.stops) < float("inf")


@pytest.mark.parametrize("seed", [1, 2])
def test_parts_of_stops_have_room_for_them(seed: int) -> None:
    """Nobody and nothing is in two parts or in none; each has room for most of its demand, and
    first stops stay with their vehicles.
    """
    city = generate_city(seed, vehicles=40, stops=200, segments=400)
    fleet = city.problem.fleet
    first = fleet.vehicles[7].model_copy(update={"first_stop": "stop-9"})
    vehicles = (*fleet.vehicles[:7], first, *fleet.vehicles[8:])
    fleet = Fleet(**{n: getattr(fleet, n) for n in Fleet.model_fields} | {"vehicles": vehicles})
    names = [stop.id for stop in fleet.stops]
    parts = parts_of_stops(
        replace(city.problem, fleet=fleet), FleetPart(fleet.vehicles, names), 50, seed
    )
    assert len(parts) == 4
    assert sorted(s for part in parts for s in part.stops) == sorted(names)
    assert sorted(v.id for part in parts for v in part.vehicles) == sorted(v.id for v in vehicles)
    for part in parts:
        room = sum(v.capacity or 0 for v in part.vehicles)
        assert 0.8 * sum(fleet.stop_by_id[s].demand for s in part.stops) <= room
        assert ("stop-9" in part.stops) == (first in part.vehicles)


@pytest.mark.slow
def test_tight_capacities_are_met_by_one_more_van(town: Town) -> None:
    """Four parcels at one corner, vans that take three: one van would be cheaper, but too full."""
    made = town([parcel(f"p{i}", "33") for i in range(4)], [{"capacity": 3}] * 2)
    found = routed(made)
    assert found.unassigned == ()
    assert cost_kwh(made, found.stops) < float("inf")
    assert sorted(map(len, found.stops.values())) in ([1, 3], [2, 2])


def test_stops_that_are_all_anybodys_are_served_by_several_carriers(town: Town) -> None:
    """No carrier has a part of its own to begin with."""
    vehicles = [{"capacity": 1, "carrier": carrier} for carrier in "ab"]
    made = town([parcel("s1", "03"), parcel("s2", "30")], vehicles)
    found = routed(made)
    assert served(found) == ["s1", "s2"]
    assert all(len(stops) == 1 for stops in found.stops.values())


def test_what_is_too_much_stays_behind_and_nothing_else(town: Town) -> None:
    """Five parcels and room for three: three are served, two are named."""
    made = town(
        [parcel(f"p{i}", node) for i, node in enumerate(("33", "03", "30", "22", "11"))],
        [{"capacity": 3}],
    )
    found = routed(made)
    assert len(found.unassigned) == 2
    assert sorted([*served(found), *found.unassigned]) == ["p0", "p1", "p2", "p3", "p4"]
    assert cost_kwh(made, found.stops) < float("inf")


@pytest.mark.long
def test_windows_that_clash_leave_one_stop_out(town: Town) -> None:
    """Three far corners that close before one van can be at two of them: one is served."""
    stops = [parcel(f"p{i}", node, latest_s=130.0) for i, node in enumerate(("33", "30", "03"))]
    made = town([*stops, parcel("any", "11")], [{}])
    alone = [routed(town([stop], [{}])).unassigned for stop in stops]
    found = routed(made)
    assert () in alone
    assert "any" in served(found)
    assert len(found.unassigned) == 2
    assert cost_kwh(made, found.stops) < float("inf")


@pytest.mark.slow
def test_pieces_of_a_network_are_served_from_their_own_depot(town: Town) -> None:
    """A depot in town and one apart: nobody is sent where there is no way, even where the only
    other choice is to leave a parcel behind.
    """
    stops = [parcel("a", "33"), parcel("b", "p"), parcel("c", "p")]
    vans = [{"depot": "depot-0", "capacity": 9}, {"depot": "depot-1", "capacity": 9}]
    made = town(stops, vans, ("00", "q"))
    found = routed(made)
    assert found.unassigned == ()
    assert found.stops["van-0"] == ("a",)
    assert sorted(found.stops["van-1"]) == ["b", "c"]
    heavy = [parcel("a", "33"), *({**stop, "demand": 5} for stop in stops[1:])]
    small = town(heavy, [{"depot": "depot-0"}, {**vans[1], "capacity": 5}], ("00", "q"))
    found = routed(small)
    assert cost_kwh(small, found.stops) < float("inf")
    assert found.stops["van-0"] == ("a",)
    assert len(found.unassigned) == 1


def test_a_vehicle_whose_first_stop_is_not_asked_for_stays_idle(town: Town) -> None:
    """Its parcel cannot be delivered, so it does not drive; if it is the only one, nobody does."""
    stops = [parcel("far", "q"), parcel("near", "33")]
    made = town(stops, [{"first_stop": "far"}, {}])
    with ThreadPoolExecutor(1) as thread:
        found = base_routes(made[0], travel_of(made), ["near"], SHORT, thread, 1)
        assert found.stops == {"van-0": (), "van-1": ("near",)}
        alone = town(stops, [{"first_stop": "far"}])
        found = base_routes(alone[0], travel_of(alone), ["near"], SHORT, thread, 1)
        assert (found.stops, found.unassigned) == ({"van-0": ()}, ("near",))
        found = base_routes(made[0], travel_of(made), [], SHORT, thread, 1)
        assert (found.stops, found.unassigned) == ({"van-0": (), "van-1": ()}, ())


@pytest.mark.parametrize("on_submit", [True, False])
def test_workers_that_die_cost_rounds_and_no_more(
    town: Town, on_submit: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """With every part failing, the first routes stand, and the log says why."""
    made = town(
        [parcel(f"p{i}", n) for i, n in enumerate(("33", "03", "30", "22"))], [{"capacity": 2}] * 2
    )
    found = routed(made, executor=Broken(on_submit=on_submit))
    first = routed(made, SHORT.model_copy(update={"rounds": 0}))
    assert found.stops == first.stops
    assert found.unassigned == ()
    assert found.timed_out
    assert "part of the search failed" in caplog.text


@pytest.mark.slow
def test_a_search_that_is_never_answered_holds_no_cycle_up(
    town: Town, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first routes stand once its time is over, and nobody works at it any more."""
    monkeypatch.setattr(sys.modules[base_routes.__module__], "_LATE_S", 0.1)
    made = town([parcel(f"p{i}", n) for i, n in enumerate(("33", "03"))], [{"capacity": 2}])
    silent = Silent()
    found = routed(made, SHORT.model_copy(update={"time_limit_s": 0.3}), executor=silent)
    assert sorted(served(found)) == ["p0", "p1"]
    assert found.timed_out
    assert silent.asked
    assert all(future.cancelled() for future in silent.asked)
    assert "part of the search failed: TimeoutError: no answer within 0 s" in caplog.text


def test_routes_of_the_last_cycle_are_where_the_search_starts(town: Town) -> None:
    """Sound routes are kept as they are without rounds, whoever is gone left out; with rounds
    they only get better.
    """
    made = town([parcel(f"p{i}", n) for i, n in enumerate(("33", "03", "30", "22"))], [{}, {}])
    last = {"van-0": ["p0", "gone", "p1"], "van-1": ["p2", "p3"], "van-9": ["p0"]}
    kept = routed(made, SHORT.model_copy(update={"rounds": 0}), start=last)
    found = {tuple(stops) for stops in kept.stops.values()}
    assert found == {("p0", "p1"), ("p2", "p3")}
    better = routed(made, start=last)
    assert cost_kwh(made, better.stops) < cost_kwh(made, kept.stops)


@pytest.mark.slow
def test_a_city_in_parts_is_searched_deeply_in_the_second_half() -> None:
    """Rounds of the second half are two in one, but an odd last one, and a unit too many may cost
    ten times as much from the start; a city of one part has neither.
    """
    shape = CityShape(depots=1, window_share=0.0)
    city = generate_city(2, vehicles=8, stops=32, segments=200, shape=shape)
    made = city.problem, city.snapshot
    settings = SHORT.model_copy(update={"rounds": 7, "iterations_per_stop": 1, "part_stops": 10})
    with Watched() as parts, Watched() as whole:
        routed(made, settings, executor=parts)
        routed(made, settings.model_copy(update={"part_stops": 100}), executor=whole)
    rounds = [a for a in parts.attempts if not a.first]
    assert [len(list(of)) for _, of in groupby(rounds, key=lambda a: a.deep)] == [16, 4, 4]
    assert sum(a.iterations for a in rounds if a.deep) == 2 * 32
    assert not any(a.deep for a in whole.attempts)
    low, high = (sorted({a.penalty.max_penalty for a in w.attempts})[0] for w in (whole, parts))
    assert high == pytest.approx(10 * low)


@pytest.mark.parametrize(
    ("load", "factor"), [(0.0, 1.0), (1.0, 5.0), (2.5, 2.0), (5.0, 1.0), (80.0, 1.0)]
)
def test_a_stop_too_many_costs_as_much_where_stops_have_few_units(
    load: float, factor: float
) -> None:
    """At least: a unit of five or more costs what was measured, and of none there is no load."""
    measured = low_penalties(SHORT, 5.0, full=False).max_penalty
    assert low_penalties(SHORT, load, full=False).max_penalty == pytest.approx(factor * measured)

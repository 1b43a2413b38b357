from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.routes import lateness_s
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.routes.itineraries import Planner
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
REFERENCE_S = 10.0


def planner_of(made: tuple[RoutingProblem, TrafficSnapshot]) -> Planner:
    """A planner for a fleet that starts ten seconds from now."""
    problem, snapshot = made
    travel = Travel(problem, roads_of(problem, snapshot))
    return Planner(problem, snapshot, [travel], 3.0, REFERENCE_S)


def test_departure_windows_count_from_the_reference_time(town: Town) -> None:
    """Without an end the window is one moment: when the vehicle is ready."""
    planner = planner_of(
        town(["33"], [{}, {"ready_s": 5.0}, {"ready_s": 5.0, "depart_by_s": 65.0}])
    )
    assert [planner.windows.of(n) for n in range(3)] == [(10.0, 10.0), (15.0, 15.0), (15.0, 75.0)]


def test_an_itinerary_costs_its_legs_and_passes_what_it_drives(town: Town) -> None:
    """Cost is the legs' sum; its way has the exact entries and exits of all open segments."""
    _, snapshot = made = town(["33", "03"], [{"depart_by_s": 60.0}], open_share=0.5)
    planner = planner_of(made)
    legs = planner.legs(0, ("s0", "s1"))
    assert legs is not None
    itinerary = planner.itinerary(0, ("s0", "s1"), legs, 30.0)
    assert itinerary is not None
    assert itinerary.route is not None
    assert itinerary.depart_s == 30.0
    travel = planner.travels[0]
    rows = [travel.row[place] for place in ("depot-0", "s0", "s1", "depot-0")]
    assert itinerary.cost_kwh == pytest.approx(
        sum(travel.energy_kwh[i, j] for i, j in pairwise(rows))
    )
    passed = sorted((s, *times) for s, ps in itinerary.traversals.items() for *times, _ in ps)
    driven = [(s, a, b) for _, _, s, a, b in itinerary.route.entries_s()]
    assert passed == sorted(x for x in driven if snapshot.segments[x[0]].open)
    assert 0 < len(passed) < len(driven)


def test_an_itinerary_keeps_its_windows_or_is_none(town: Town) -> None:
    """A departure, a stop or a return outside its window, or a way that is missing: none."""
    late = {"id": "late", "node": "33", "latest_s": 500.0}
    van = {"ready_s": 5.0, "depart_by_s": 400.0, "return_by_s": 900.0}
    planner = planner_of(town([late, {"id": "far", "node": "q"}], [van]))
    legs = planner.legs(0, ("late",))
    assert planner.legs(0, ("far",)) is None
    assert planner.itinerary(0, ("far",), None) is None
    assert planner.itinerary(0, ("late",), legs, 14.9) is None
    assert planner.itinerary(0, ("late",), legs, 410.1) is None
    found = planner.itinerary(0, ("late",), legs, 15.0)
    assert found is not None
    assert found.route is not None
    drive_s = found.route.visits[1].arrival_s - 15.0
    last = REFERENCE_S + 500.0 - drive_s
    assert last < 410.0
    on_time = planner.itinerary(0, ("late",), legs, last - 1e-3)
    assert on_time is not None
    assert on_time.route is not None
    vehicle = planner.problem.fleet.vehicles[0]
    assert lateness_s(planner.problem, vehicle, on_time.route, REFERENCE_S) <= 0
    assert planner.itinerary(0, ("late",), legs, last + 1e-3) is None


def test_keys_tell_departures_apart_to_a_tenth_of_a_second(town: Town) -> None:
    """The same route at the same tenth is the same option; another tenth or order is another."""
    planner = planner_of(town(["33", "03"], [{"depart_by_s": 60.0}]))

    def key(depart_s: float, *stops: str) -> object:
        itinerary = planner.itinerary(0, stops, planner.legs(0, stops), depart_s)
        assert itinerary is not None
        return itinerary.key

    assert key(20.0, "s0", "s1") == key(20.01, "s0", "s1")
    assert key(20.0, "s0", "s1") != key(20.2, "s0", "s1")
    assert key(20.0, "s0", "s1") != key(20.0, "s1", "s0")

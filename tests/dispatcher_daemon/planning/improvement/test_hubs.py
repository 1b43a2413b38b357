"""Waiting at a hub on the way: where a driver has to rest anyway, a wait may be free."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dispatcher_daemon.fleet import fleet_from
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import run_cycle
from dispatcher_daemon.planning.improvement.departures import best_departure
from dispatcher_daemon.planning.improvement.hubs import over_hubs
from dispatcher_daemon.planning.plans import Cycle, verify_plans
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import SegmentTraffic, TrafficSnapshot
from slipstream.messages import VehiclePlan
from slipstream.roads import Segment, build_network
from tests.dispatcher_daemon.fleet.tracking.fleet_drive import Day, Van

APART_S = 200.0
SETTINGS = DispatcherSettings(
    form="route",
    solvers=("exact",),
    city=CitySettings(search=SearchSettings(rounds=1, iterations_per_stop=5, workers=1)),
)


def problem(
    hubs: tuple[str, ...] = ("m",),
    price_of_time_kw: float = 20.0,
    carriers: tuple[str, str] = ("a", "a"),
) -> tuple[RoutingProblem, TrafficSnapshot]:
    """Roads from two depots, w and x, join at m and lead on to e, 20 km each; the van from x starts
    200 s later, and neither may wait at its depot.
    """
    at = {"w": (0.0, 0.0), "x": (0.0, 9e3), "m": (2e4, 0.0), "e": (4e4, 0.0)}
    ways = [("w", "m"), ("x", "m"), ("m", "e")]
    roads = [
        Segment(f"{a}-{b}", a, b, 20_000.0, 30.0, 1, (at[a], at[b]))
        for pair in ways
        for a, b in (pair, pair[::-1])
    ]
    network = build_network("junction", roads, at)
    fleet = fleet_from(
        {
            "depots": [{"id": "west", "node": "w"}, {"id": "north", "node": "x"}],
            "stops": [{"id": name, "node": "e", "service_s": 60.0} for name in ("s0", "s1")],
            "vehicles": [
                {"id": "early", "depot": "west", "first_stop": "s0", "carrier": carriers[0]},
                {
                    "id": "late",
                    "depot": "north",
                    "first_stop": "s1",
                    "ready_s": APART_S,
                    "carrier": carriers[1],
                },
            ],
            "hubs": [{"id": f"rest-{node}", "node": node} for node in hubs],
        },
        network,
        "fleet",
    )
    traffic = {
        name: SegmentTraffic(name, segment.speed_limit_mps, y_e=1, open=True, reason=None)
        for name, segment in network.segments.items()
    }
    found = RoutingProblem(network, fleet, price_of_time_kw=price_of_time_kw)
    return found, TrafficSnapshot(0, traffic, ())


def planned(
    found: tuple[RoutingProblem, TrafficSnapshot],
) -> tuple[Planner, Itinerary, Itinerary]:
    """Both vans on their way as soon as they are ready."""
    of, snapshot = found
    planner = Planner(of, snapshot, [Travel(of, roads_of(of, snapshot))], 3.0, 10.0)
    early, late = (planner.itinerary(n, (f"s{n}",), planner.legs(n, (f"s{n}",))) for n in (0, 1))
    assert early is not None
    assert late is not None
    return planner, early, late


def test_a_van_waits_at_a_hub_until_another_comes_by() -> None:
    """It pays for the stop and not for the time, and both save from there on."""
    planner, early, late = planned(problem())
    meetings = planner.book.meetings()
    meetings.add(late.traversals)
    best = best_departure(planner, early, meetings)
    assert best.route is not None
    assert [visit.place for visit in best.route.visits] == ["west", "rest-m", "s0", "west"]
    hub = best.route.visits[1]
    # The other passes the hub at full speed, and this one starts from rest: it leaves before.
    assert APART_S - 60 < hub.wait_s < APART_S
    shares = planner.book.shares["m-e"]
    together = shares.leader_kwh + shares.follower_kwh
    # Both of them, and on the way home until they part.
    assert meetings.gain_kwh(best.traversals) >= together - 1e-9
    legs = [leg.cost_kwh for leg in best.route.legs]
    assert best.cost_kwh == pytest.approx(sum(legs))
    assert meetings.gain_kwh(best.traversals) > best.cost_kwh - early.cost_kwh > 0


@pytest.mark.parametrize("hubs", [(), ("x",)])
def test_without_a_hub_on_its_way_nobody_waits(hubs: tuple[str, ...]) -> None:
    """A hub at the other depot would be a detour of 40 km; at its own stop a wait costs wages."""
    planner, early, late = planned(problem(hubs))
    assert list(over_hubs(planner, early)) == []
    meetings = planner.book.meetings()
    meetings.add(late.traversals)
    assert best_departure(planner, early, meetings).key == early.key


def test_a_wait_that_is_paid_for_has_to_pay() -> None:
    """At the price of driving no wait of 200 s does."""
    found, snapshot = problem()
    dear = replace(found, price_of_waiting_kw=found.price_of_time_kw)
    planner, early, late = planned((dear, snapshot))
    meetings = planner.book.meetings()
    meetings.add(late.traversals)
    assert best_departure(planner, early, meetings).key == early.key


def cycle_of(found: tuple[RoutingProblem, TrafficSnapshot]) -> tuple[VehiclePlan, ...]:
    """The plans of a cycle."""
    result = run_cycle(Cycle(*found, SETTINGS, 1, 0, 1), solve_in_process([ExactSolver()]))
    assert result.report.status == "ok", result.report
    return result.plans


def test_a_plan_over_a_hub_is_verified_and_valid_until_its_end() -> None:
    """The message says where it waits, that nothing is served there, and in which platoon it
    leaves; a plan that hides the hub or names another place is refused.
    """
    found = problem()
    plans = cycle_of(found)
    early = next(plan for plan in plans if plan.vehicle == "early")
    hub = early.stops[1]
    assert (hub.stop, hub.is_hub, hub.node) == ("rest-m", True, "m")
    assert hub.departure_ns - hub.arrival_ns == pytest.approx(1e9 * hub.wait_s, abs=2)
    assert [stop.stop for stop in early.service_stops] == ["s0"]
    assert early.valid_until_ns >= early.stops[-1].arrival_ns
    platoons = {plan.vehicle: {s.platoon for s in plan.segments} - {None} for plan in plans}
    assert platoons["early"] & platoons["late"]

    def faults(**change: object) -> tuple[str, ...]:
        stops = (early.stops[0], hub.model_copy(update=change), *early.stops[2:])
        changed = early.model_copy(update={"stops": stops})
        others = [plan for plan in plans if plan.vehicle != "early"]
        open_segments = set(found[0].network.segments)
        return verify_plans(
            [changed, *others],
            found[0].network,
            found[0].fleet,
            open_segments,
            SETTINGS.sync_window_s,
            reference_s=SETTINGS.deadline_s,
        )

    assert faults() == ()
    assert any("no stop rest-m" in fault for fault in faults(is_hub=False))
    assert any("no stop s9" in fault for fault in faults(stop="s9"))
    assert any("before it is served" in fault for fault in faults(wait_s=hub.wait_s + 1.0))


def test_a_meeting_on_a_road_that_is_usually_calm_is_planned_before_it_is() -> None:
    """The van waits for the other one, in no platoon yet: gates are closed now. Where they are
    usually closed too, it does not.
    """
    found, snapshot = problem()
    for share, hubs in ((1.0, 1), (0.1, 0)):
        traffic = {
            name: replace(of, open=False, y_e=0, reason="turbulent", age_s=1.0, usual_share=share)
            for name, of in snapshot.segments.items()
        }
        plans = cycle_of((found, replace(snapshot, segments=traffic)))
        assert sum(stop.is_hub for plan in plans for stop in plan.stops) == hubs
        assert {segment.platoon for plan in plans for segment in plan.segments} == {None}


@pytest.mark.long
def test_a_van_that_waits_at_a_hub_is_met_there() -> None:
    """Later cycles leave it alone and see it on the road, so its partner keeps its platoon."""
    found, snapshot = problem()
    vans = {"early": Van("early", "w-m"), "late": Van("late", "x-m")}
    today = Day(found, snapshot, vans, found.fleet)
    today.drive(2)
    today.run(60)
    assert today.states() == {"served": 2}
    (waiting,) = [p for p in vans["early"].plans if any(stop.is_hub for stop in p.stops[1:])]
    home = [
        (plan.cycle, {s.platoon for s in plan.segments if s.segment == "e-m"})
        for plan in vans["late"].plans
        if any(s.segment == "e-m" for s in plan.segments)
    ]
    meanwhile = [names for cycle, names in home if cycle > waiting.cycle]
    assert len(meanwhile) > 2
    assert {None} not in meanwhile

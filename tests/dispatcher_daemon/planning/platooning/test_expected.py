"""Expected drafting: closing up, gaps behind gates, signals, and where all of it counts."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import pytest

from dispatcher_daemon.fleet import fleet_from, on_road
from dispatcher_daemon.fleet.commitments import Commitment, CommittedLeg, Moving
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.improvement.carriers import Accounts
from dispatcher_daemon.planning.improvement.sweeps import choice_of
from dispatcher_daemon.planning.plans.energy import route_energy
from dispatcher_daemon.planning.platooning import (
    counted_drafting,
    expected_drafting,
    form_platoons,
    judge_pairs,
)
from dispatcher_daemon.planning.platooning.closing_up import SIGNAL_CYCLE_S, closing_way_m
from dispatcher_daemon.planning.platooning.expected import ExpectedDrafting
from dispatcher_daemon.planning.roads import (
    RoadLeg,
    Travel,
    candidate_arcs,
    least_energy_legs,
    roads_of,
)
from dispatcher_daemon.planning.routes.itineraries import Planner
from dispatcher_daemon.traffic.snapshot import Expectations, SegmentTraffic, TrafficSnapshot
from slipstream.energy.drive import Drive
from slipstream.energy.traction import PAPER_CAR, coasting_mps2
from slipstream.messages import DrivingAdvice, PlannedSegment, PlannedStop, VehiclePlan
from slipstream.roads import Segment, build_network
from slipstream.spacing import ADVISED_GAP_M, ENTRY_HEADWAY_S, driver_gap_m, planned_gap_m
from slipstream.vehicle_types import RoutingProfile

NOW_NS = 1_800_000_000_000_000_000
V_MPS = 20.0
C_MPS2 = coasting_mps2(V_MPS, PAPER_CAR)
WANTED_M = planned_gap_m(V_MPS, ADVISED_GAP_M, RoutingProfile().braking)
ENTRY_M = ENTRY_HEADWAY_S * V_MPS - WANTED_M
GATE_M = driver_gap_m(V_MPS) - WANTED_M
PARTED = ENTRY_HEADWAY_S / SIGNAL_CYCLE_S


def line(
    lengths_m: Mapping[str, float],
    vehicles: Sequence[dict[str, Any]] = ({}, {}),
    stops: Sequence[dict[str, Any]] = (),
    *,
    closed: Collection[str] = (),
    signals: Mapping[str, float] = MappingProxyType({}),
    **more: Any,
) -> tuple[RoutingProblem, TrafficSnapshot]:
    """Roads "ab", "bc" ... between junctions of one letter, one way each but for the way home.

    Args:
        lengths_m: of the roads.
        closed: roads whose gates are not open.
        signals: expected stops at junctions with signals.
        more: of the problem.
    """
    nodes = sorted({node for road in lengths_m for node in road})
    at = {node: (100.0 * number, 0.0) for number, node in enumerate(nodes)}
    roads = [
        Segment(name, name[0], name[1], length_m, V_MPS, 1, (at[name[0]], at[name[1]]))
        for name, length_m in lengths_m.items()
    ]
    network = build_network("line", roads, at, signals=signals)
    fleet = fleet_from(
        {
            "depots": [{"id": f"depot-{node}", "node": node} for node in nodes],
            "stops": list(stops) or [{"id": "s", "node": nodes[-1]}],
            "vehicles": [{"id": f"v{n}", "depot": "depot-a", **v} for n, v in enumerate(vehicles)],
        },
        network,
        "line",
    )
    gates = {
        road.id: SegmentTraffic(
            road.id,
            V_MPS,
            y_e=1,
            open=road.id not in closed,
            reason="turbulent" if road.id in closed else None,
            age_s=1.0,
            stops=signals.get(road.end, 0.0),
        )
        for road in roads
    }
    problem = RoutingProblem(network, fleet, **{"drafting": "expected", **more})
    return problem, TrafficSnapshot(NOW_NS, gates, ())


def shares(
    problem: RoutingProblem, snapshot: TrafficSnapshot, *paths: Sequence[str]
) -> tuple[float, ...]:
    """On the last segment of paths that vehicles come over, each from rest."""
    of = expected_drafting(problem, snapshot)
    assert of is not None
    return of.shares(tuple(of.along(path)[-1] for path in paths))


def test_the_law_by_hand() -> None:
    """At 20 m/s the leader is 3 m/s slower. With c = 0.9 · 0.25 m/s² it takes 13.33 s to get there
    and back, in which 40 m are closed; 100 m need 46.67 s, 10 m are closed before it gets there.
    """
    assert closing_way_m(100.0, 20.0, 0.25) == pytest.approx(20 * (100 / 3 + 3 / 0.225))
    assert closing_way_m(40.0, 20.0, 0.25) == pytest.approx(20 * 2 * 3 / 0.225)
    assert closing_way_m(10.0, 20.0, 0.25) == pytest.approx(20 * 2 * math.sqrt(10 / 0.225))
    assert closing_way_m(0.0, 20.0, 0.25) == 0.0


def test_who_starts_from_rest_closes_up_place_by_place_and_carries_the_rest_over() -> None:
    """Three of one depot: 56.5 m a gap. The first follower is close before the end of the first
    kilometre, the second on the next one; after that nothing is left.
    """
    first_m, second_m = (closing_way_m(k * ENTRY_M, V_MPS, C_MPS2) for k in (1, 2))
    assert 500 < first_m < 1000 < second_m < 2000
    roads = {"ab": 1000.0, "bc": 1000.0, "cd": 1000.0}
    town = line(roads, [{}] * 3)
    one = 1 - first_m / 1000
    assert shares(*town, *[["ab"]] * 3) == pytest.approx((one, one, 0.0))
    assert shares(*town, *[["ab", "bc"]] * 3) == pytest.approx((1.0, 1.0, 2 - second_m / 1000))
    assert shares(*town, *[["ab", "bc", "cd"]] * 3) == (1.0, 1.0, 1.0)


def test_roads_without_platooning_close_nothing_and_open_gaps_again() -> None:
    """Before the first open road gaps stay those of the entry; behind a closed one they are the
    drivers', and those that were never closed are what they were.
    """
    roads = {"ab": 5000.0, "bc": 2000.0, "cd": 1000.0, "de": 3000.0}
    first_m, second_m = (closing_way_m(k * ENTRY_M, V_MPS, C_MPS2) for k in (1, 2))
    town = line(roads, [{}] * 3, closed=("ab", "cd"))
    assert shares(*town, *[["ab", "bc"]] * 3)[1:] == pytest.approx(
        (1 - first_m / 2000, max(0.0, 1 - second_m / 2000))
    )
    again_m = [closing_way_m(k * GATE_M, V_MPS, C_MPS2) for k in (1, 2)]
    assert shares(*town, *[["ab", "bc", "cd", "de"]] * 3)[1:] == pytest.approx(
        [1 - way_m / 3000 for way_m in again_m]
    )
    short = line({**roads, "bc": 300.0}, [{}] * 3, closed=("ab", "cd"))
    left_m = [
        max(one - 300, other) for one, other in zip((first_m, second_m), again_m, strict=True)
    ]
    assert left_m[1] == second_m - 300 > again_m[1]
    assert shares(*short, *[["ab", "bc", "cd", "de"]] * 3)[1:] == pytest.approx(
        [1 - way_m / 3000 for way_m in left_m]
    )


def test_who_joins_a_close_platoon_closes_its_own_gap_only() -> None:
    """Two come together over 5 km, the third one meets them: it is as long behind as one follower
    would be, those in front are close; in front of them, both behind it have gaps to close.
    """
    town = line({"ac": 5000.0, "bc": 5000.0, "cd": 3000.0}, [{}] * 3)
    ours, theirs = ["ac", "cd"], ["bc", "cd"]
    first_m, second_m = (closing_way_m(k * ENTRY_M, V_MPS, C_MPS2) for k in (1, 2))
    assert second_m < 3000
    assert shares(*town, ours, ours, theirs) == pytest.approx((1.0, 1.0, 1 - first_m / 3000))
    assert shares(*town, theirs, ours, ours) == pytest.approx((1 - first_m / 3000,) * 2 + (1.0,))
    assert shares(*town, ours, theirs, ours)[2] == pytest.approx(1 - second_m / 3000)


def test_same_approach_and_different_approaches_to_a_signal() -> None:
    """Half of all passages stop at c. Two from a come to it together: parted once in a cycle, from
    rest again in half of the cases. Of two from a and b none may have stopped, and who is a stop
    behind does not close up within 2 km.
    """
    roads = {"ac": 5000.0, "bc": 5000.0, "cd": 2000.0}
    town = line(roads, signals={"c": 0.5})
    anew = 1 - closing_way_m(ENTRY_M, V_MPS, C_MPS2) / 2000
    assert 0 < anew < 1
    same = shares(*town, ["ac", "cd"], ["ac", "cd"])[1]
    assert same == pytest.approx(0.5 + (0.5 - PARTED) * anew)
    assert shares(*town, ["ac", "cd"], ["bc", "cd"])[1] == pytest.approx(0.25 * anew)
    calm = line(roads, signals={"c": 0.0})
    assert shares(*calm, ["ac", "cd"], ["ac", "cd"])[1] == 1.0
    assert shares(*calm, ["ac", "cd"], ["bc", "cd"])[1] == pytest.approx(anew)


def test_a_segment_that_the_network_no_longer_has_ends_nothing() -> None:
    """A plan of before a restart: its vehicle counts as under way behind it."""
    problem, snapshot = line({"ab": 500.0, "bc": 2000.0})
    of = expected_drafting(problem, snapshot)
    assert of is not None
    gone, behind = of.along(["zz", "bc"])
    assert gone < 0 <= behind
    assert of.shares((behind, behind)) == (1.0, 1.0)


def test_learned_stops_count_before_those_of_the_settings() -> None:
    """What vehicles have seen at a movement replaces the signals' average."""
    problem, snapshot = line({"ac": 5000.0, "cd": 2000.0}, signals={"c": 0.5})
    learned = replace(snapshot, expected=Expectations({}, {}, {("ac", "cd"): 0.1}))
    anew = 1 - closing_way_m(ENTRY_M, V_MPS, C_MPS2) / 2000
    found = shares(problem, learned, ["ac", "cd"], ["ac", "cd"])[1]
    assert found == pytest.approx(0.9 + (0.1 - PARTED) * anew)
    often = replace(snapshot, expected=Expectations({}, {}, {("ac", "cd"): 1.7}))
    assert shares(problem, often, ["ac", "cd"], ["ac", "cd"])[1] == pytest.approx(
        (1 - PARTED) * anew
    )


def planned(problem: RoutingProblem, snapshot: TrafficSnapshot) -> tuple[Planner, list[Any]]:
    """Each vehicle to its stop and home again, at once."""
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0)
    found = []
    for number, stop in enumerate(problem.fleet.stops):
        one = planner.itinerary(number, (stop.id,), planner.legs(number, (stop.id,)))
        assert one is not None
        found.append(one)
    return planner, found


HOME = {"ab": 1000.0, "bc": 4000.0, "ca": 3000.0}
TO_C = tuple({"id": f"s{n}", "node": "c"} for n in range(3))


def test_objective_accounts_energy_and_messages_expect_the_same() -> None:
    """Three vans of one depot: the blocks' and sweeps' saving, what the carrier gains, what the
    drives need and how far they are in platoons all count the same shares, and less than ideally.
    """
    problem, snapshot = line(HOME, [{}] * 3, TO_C)
    planner, vans = planned(problem, snapshot)
    choice = choice_of(planner, vans)
    gains = Accounts(planner, vans, vans).gains_kwh()
    assert gains[None] == pytest.approx(choice.saving_kwh)
    expected = expected_drafting(problem, snapshot)
    places = form_platoons(choice.routes, snapshot, 3.0, 8, 1, expected=expected)
    energies = [route_energy(problem, route, places) for route in choice.routes]
    drag_kwh = sum(e.undrafted.total_kwh - e.driven.total_kwh for e in energies)
    # Planning speeds are those of the segments, drives begin and end at rest.
    assert drag_kwh == pytest.approx(choice.saving_kwh, rel=0.08)
    of_route = [p.share for passage, p in places.items() if passage[0] == "v2"]
    lengths_m = list(HOME.values())
    assert len(of_route) == 3
    assert energies[2].platooned_m == pytest.approx(
        sum(share * m for share, m in zip(of_route, lengths_m, strict=True))
    )
    ideal = choice_of(*planned(replace(problem, drafting="ideal"), snapshot))
    assert 0.5 * ideal.saving_kwh < choice.saving_kwh < 0.9 * ideal.saving_kwh


def test_the_arc_form_s_rewards_expect_it_too() -> None:
    """A pair of arcs of one depot saves the follower's share of what it saves ideally."""
    problem, snapshot = line(HOME, [{}] * 2, TO_C[:1])

    def rewards(of: RoutingProblem) -> dict[str, float]:
        arcs = candidate_arcs(of, least_energy_legs(of, snapshot))
        return {p.segment: p.saving_kwh for p in judge_pairs(of, arcs, snapshot, 3.0)}

    ideal, found = rewards(replace(problem, drafting="ideal")), rewards(problem)
    first_m = closing_way_m(ENTRY_M, V_MPS, C_MPS2)
    assert found["ab"] == pytest.approx((1 - first_m / 1000) * ideal["ab"])
    assert found["bc"] == pytest.approx(ideal["bc"])


def test_the_paper_s_objective_is_untouched() -> None:
    """It counts platoons as close from where they form, whatever is said of drafting; the energy
    that is reported does not.
    """
    problem, snapshot = line(HOME, [{}] * 3, TO_C, signals={"b": 0.5}, objective="paper")
    assert counted_drafting(problem, snapshot) is None
    assert expected_drafting(problem, snapshot) is not None
    same = replace(problem, drafting="ideal")
    assert (
        choice_of(*planned(problem, snapshot)).saving_kwh
        == choice_of(*planned(same, snapshot)).saving_kwh
    )


def plan_of(vehicle: str, node: str, path: Sequence[str]) -> VehiclePlan:
    """A plan that began at the present moment, 50 s a segment."""
    ns = 50 * 10**9
    times = [(NOW_NS + n * ns, NOW_NS + (n + 1) * ns) for n in range(len(path))]
    segments = tuple(
        PlannedSegment(
            segment=road,
            entry_ns=entry,
            exit_ns=leaving,
            speed_mps=V_MPS,
            platoon=None,
            place=None,
            gap_m=None,
            leg=0,
        )
        for road, (entry, leaving) in zip(path, times, strict=True)
    )
    stops = tuple(
        PlannedStop(stop=stop, node=at, arrival_ns=time_ns, departure_ns=time_ns)
        for stop, at, time_ns in (("depot-a", node, NOW_NS), ("depot-d", "d", times[-1][1]))
    )
    return VehiclePlan(
        vehicle=vehicle,
        cycle=1,
        issued_ns=NOW_NS,
        valid_until_ns=times[-1][1],
        depart_ns=NOW_NS,
        stops=stops,
        segments=segments,
        distance_m=1.0,
        energy_kwh=1.0,
        advice=DrivingAdvice(),
    )


def test_what_vehicles_on_the_road_have_behind_them_counts() -> None:
    """Of two that left a depot together the gap is what the way since then has left of it; two that
    were planned under way are close.
    """
    problem, snapshot = line({"ab": 300.0, "bc": 300.0, "cd": 3000.0})
    later_ns = NOW_NS + 40 * 10**9

    def share(node: str, path: Sequence[str]) -> float:
        users = on_road([plan_of(v, node, path) for v in ("x", "y")], later_ns)
        of = expected_drafting(problem, snapshot, (), users)
        assert isinstance(of, ExpectedDrafting)
        return of.shares(tuple(of.on_road[v, 0, len(path) - 1] for v in ("x", "y")))[1]

    left_m = closing_way_m(ENTRY_M, V_MPS, C_MPS2) - 600
    assert left_m > 0
    assert share("a", ["ab", "bc", "cd"]) == pytest.approx(1 - left_m / 3000)
    assert share("a", ["bc", "cd"]) == 1.0


def test_what_a_vehicle_that_is_planned_on_has_behind_it_counts() -> None:
    """Two that left the depot together are on the second road: their routes begin there, and what
    the first one has closed of their gap stays closed.
    """
    problem, snapshot = line(
        {"ab": 300.0, "bc": 300.0, "cd": 3000.0}, [{}, {}], [{"id": "s", "node": "d"}]
    )
    path = ("bc", "cd")
    bound = [
        Commitment(
            vehicle=v,
            plan=plan_of(v, "a", ["ab", "bc", "cd"]),
            place="depot-a",
            node="a",
            arrived_ns=NOW_NS,
            ends_ns=NOW_NS,
            departs_ns=NOW_NS,
            moving=Moving(0.2, V_MPS, NOW_NS + 60 * 10**9),
            legs=(CommittedLeg(path, complete=True),),
            stops=("s",),
        )
        for v in ("v0", "v1")
    ]
    of = expected_drafting(problem, snapshot, bound)
    assert of is not None
    leg = RoadLeg("depot-a", "s", path, 0.0, Drive((0.0,), (0.0,), (), 0.0))
    found = of.shares(tuple(of.of_leg(v, 0, leg)[1] for v in ("v0", "v1")))
    left_m = closing_way_m(ENTRY_M, V_MPS, C_MPS2) - 600
    assert found[1] == pytest.approx(1 - left_m / 3000)
    fresh = of.shares(tuple(of.of_leg(v, 1, leg)[1] for v in ("v0", "v1")))
    assert fresh[1] == pytest.approx(1 - (left_m + 300) / 3000)

from __future__ import annotations

from typing import Any

import pytest

from dispatcher_daemon.fleet import fleet_from
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.routes.servability import obstacles, unservable
from dispatcher_daemon.traffic.snapshot import take_snapshot
from slipstream.roads import RoadNetwork, Segment, build_network


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    """A chain d ↔ a ↔ b, a dead end a → trap, and an island far ↔ away; each road 1,000 m."""
    pairs = ["d a", "a d", "a b", "b a", "a trap", "far away", "away far"]
    ways = [tuple(pair.split()) for pair in pairs]
    junctions = {name: (0.0, 0.0) for way in ways for name in way}
    line = ((0.0, 0.0), (1.0, 0.0))
    return build_network(
        "pieces",
        [Segment(f"{a}-{b}", a, b, 1000.0, 10.0, 1, line) for a, b in ways],
        junctions,
        {f"{a}-{b}": tuple(f"{c}-{d}" for c, d in ways if c == b) for a, b in ways},
    )


def problem_of(network: RoadNetwork, **changes: Any) -> RoutingProblem:
    """One depot, stops at a and b, one van, with changes to them."""
    data: dict[str, Any] = {
        "depots": [{"node": "d"}, *changes.get("depots", [])],
        "stops": [
            {"id": "near", "node": "a", **changes.get("near", {})},
            {"id": "wide", "node": "b", **changes.get("wide", {})},
            *changes.get("stops", []),
        ],
        "vehicles": [{"id": "van", **changes.get("van", {})}, *changes.get("vehicles", [])],
    }
    return RoutingProblem(network, fleet_from(data, network, "fleet.toml"))


def found(network: RoadNetwork, **changes: Any) -> dict[str, str]:
    """What is unservable."""
    snapshot = take_snapshot(network, [], 0, stale_after_s=5.0)
    return unservable(problem_of(network, **changes), snapshot)


@pytest.mark.parametrize(
    ("order", "van", "expected"),
    [
        ({}, {}, "could serve it alone, no plan with it was found"),
        ({"skills": ["cold"]}, {}, "lacks cold"),
        ({"carrier": "a"}, {"carrier": "b"}, "not of carrier a"),
        ({"vehicle": "other"}, {}, "kept for other"),
        ({"demand": 9}, {"capacity": 5}, "holds 5"),
        ({"latest_s": 50.0}, {}, "there at 108 s"),
        ({}, {"return_by_s": 200.0}, "back 75 s too late"),
        ({"mass_kg": 5000.0}, {"type": "van"}, "would carry 5000 kg, more than its payload of"),
        ({"node": "far"}, {}, "no way there"),
        ({"node": "trap"}, {}, "no way back"),
    ],
)
def test_what_keeps_an_idle_vehicle_from_an_order(
    network: RoadNetwork, order: dict[str, Any], van: dict[str, Any], expected: str
) -> None:
    """Each of the vehicles that are asked for, and no stop but those."""
    able = {"skills": ["cold"], "carrier": "a"}
    problem = problem_of(network, near=order, van=van, vehicles=[{"id": "other", **able}])
    snapshot = take_snapshot(network, [], 0, stale_after_s=5.0)
    told = obstacles(problem, snapshot, ["van"], ["near"])
    assert (list(told), list(told["near"])) == (["near"], ["van"])
    assert told["near"]["van"].startswith(expected)


def test_a_sound_fleet_has_no_unservable_stop(network: RoadNetwork) -> None:
    """Where everything can be served, nothing is named; a stop at the depot is no way at all."""
    assert found(network, stops=[{"id": "door", "node": "d"}]) == {}


def test_a_network_in_pieces_costs_only_the_stops_that_lie_apart(network: RoadNetwork) -> None:
    """A stop on an island, and one in a trap, are named with node and depot; the others are not."""
    stops = [{"id": "island", "node": "far"}, {"id": "dead", "node": "trap"}]
    assert found(network, stops=stops) == {
        "island": "node 'far' cannot be reached from depot 'depot'",
        "dead": "node 'trap' cannot be left for depot 'depot'",
    }


def test_only_vehicles_of_its_carrier_count(network: RoadNetwork) -> None:
    """One that could serve it and may not is none; that it may not is said."""
    near = {"carrier": "a", "demand": 9}
    assert found(network, near=near, van={"carrier": "a"}, vehicles=[{"id": "w"}]) == {}
    small = {"carrier": "a", "capacity": 5}
    assert found(network, near=near, van=small, vehicles=[{"id": "w"}]) == {
        "near": "its demand of 9 is above every capacity (nearest: 5 of 'van'); "
        "it is of carrier 'a'"
    }


def test_a_carrier_whose_vehicles_are_all_away_is_named(network: RoadNetwork) -> None:
    """A file without any is refused; in a cycle they may all be under way."""
    stops = [
        {"id": "near", "node": "a", "carrier": "a"},
        {"id": "wide", "node": "b", "carrier": "b"},
    ]
    vehicles = [{"id": "van", "carrier": "a"}, {"id": "w", "carrier": "b"}]
    data = {"depots": [{"node": "d"}], "stops": stops, "vehicles": vehicles}
    fleet = fleet_from(data, network, "fleet.toml")
    left = fleet.model_copy(update={"vehicles": fleet.vehicles[:1]})
    snapshot = take_snapshot(network, [], 0, stale_after_s=5.0)
    assert unservable(RoutingProblem(network, left), snapshot) == {
        "wide": "no vehicle of its carrier 'b' is free"
    }


def test_a_depot_on_the_island_serves_the_island(network: RoadNetwork) -> None:
    """A stop is servable if one vehicle's depot reaches it; a depot without vehicles does not."""
    stops, depots = [{"id": "island", "node": "far"}], [{"id": "port", "node": "away"}]
    assert list(found(network, stops=stops, depots=depots)) == ["island"]
    boat = [{"id": "boat", "depot": "port"}]
    assert found(network, stops=stops, depots=depots, vehicles=boat) == {}


@pytest.mark.parametrize(
    ("changes", "reasons"),
    [
        (
            {"wide": {"demand": 9}, "van": {"capacity": 5}, "vehicles": [{"id": "w"}]},
            {},
        ),
        (
            {
                "wide": {"demand": 9},
                "van": {"capacity": 5},
                "vehicles": [{"id": "w", "capacity": 7}],
            },
            {"wide": "its demand of 9 is above every capacity (nearest: 7 of 'w')"},
        ),
        (
            {"near": {"demand": 3}, "wide": {"demand": 3}}
            | {"van": {"capacity": 5, "first_stop": "near"}},
            {
                "wide": "its demand of 6 (with 'near' loaded) is above every capacity "
                "(nearest: 5 of 'van')"
            },
        ),
        (
            {"wide": {"latest_s": 150.0}},
            {"wide": "its window closes at 150 s, the first to arrive ('van') is there at 208 s"},
        ),
        (
            {"van": {"ready_s": 100.0}, "near": {"latest_s": 150.0}},
            {"near": "its window closes at 150 s, the first to arrive ('van') is there at 208 s"},
        ),
        (
            {"wide": {"earliest_s": 900.0}, "van": {"return_by_s": 1000.0}},
            {"wide": "who serves it is back too late ('van' at 1168 s, due at 1000 s)"},
        ),
        (
            {"near": {"latest_s": 9.0}, "van": {"first_stop": "near"}},
            {
                "near": "its window closes at 9 s, the first to arrive ('van') is there at 108 s; "
                "it is loaded on 'van'"
            },
        ),
        (
            {"near": {"service_s": 600.0}, "wide": {"latest_s": 700.0}}
            | {"van": {"first_stop": "near"}},
            {"wide": "its window closes at 700 s, the first to arrive ('van') is there at 815 s"},
        ),
    ],
)
def test_what_rules_a_stop_out_is_named(
    network: RoadNetwork, changes: dict[str, Any], reasons: dict[str, str]
) -> None:
    """Demand, windows and returns that no vehicle can keep are named with the nearest one's."""
    assert found(network, **changes) == reasons

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dispatcher_daemon.fleet import Vehicle, arc_form_obstacle, fleet_from, load_fleet
from dispatcher_daemon.problem import RoutingProblem
from slipstream.errors import InputError


def demo_data() -> dict[str, Any]:
    """The demo's fleet as plain data."""
    return {
        "depots": [{"node": "depot"}],
        "stops": [{"id": c, "node": c} for c in ("c1", "c2", "c3", "c4")],
        "vehicles": [
            {"id": "van-a", "first_stop": "c1"},
            {"id": "van-b", "first_stop": "c3"},
        ],
    }


def test_demo_has_eight_candidate_arcs_a_vehicle(demo: RoutingProblem) -> None:
    """The demo's vans have one loaded stop each, two pooled stops between them, 16 arcs in all."""
    fleet = demo.fleet
    assert fleet.pooled == ("c2", "c4")
    assert [len(fleet.legs(v)) for v in fleet.vehicles] == [8, 8]
    assert ("c1", "c2") in fleet.legs(fleet.vehicles[0])
    assert ("depot", "c2") not in fleet.legs(fleet.vehicles[0])


def test_vehicle_without_first_stop_may_start_with_any_pooled_one(demo: RoutingProblem) -> None:
    """A vehicle with nothing loaded can go from the depot to every pooled stop and to no other."""
    legs = demo.fleet.legs(Vehicle(id="spare"))
    assert {end for start, end in legs if start == "depot"} == {"c2", "c4"}
    assert len(legs) == 6


def _drop(data: dict[str, Any]) -> None:
    data["stops"] = []


def _unknown_node(data: dict[str, Any]) -> None:
    data["stops"][1]["node"] = "nowhere"


def _depot_node(data: dict[str, Any]) -> None:
    data["depots"][0]["node"] = "nowhere"


def _twice(data: dict[str, Any]) -> None:
    data["stops"].append({"id": "c1", "node": "west"})


def _vehicle_twice(data: dict[str, Any]) -> None:
    data["vehicles"].append({"id": "van-a"})


def _no_vehicles(data: dict[str, Any]) -> None:
    data["vehicles"] = []


def _missing_stop(data: dict[str, Any]) -> None:
    data["vehicles"][0]["first_stop"] = "c9"


def _shared_stop(data: dict[str, Any]) -> None:
    data["vehicles"][1]["first_stop"] = "c1"


def _depot_twice(data: dict[str, Any]) -> None:
    data["depots"].append({"node": "west"})


def _missing_depot(data: dict[str, Any]) -> None:
    data["vehicles"][1]["depot"] = "north"


def _no_depots(data: dict[str, Any]) -> None:
    data["depots"] = []


def _closed_window(data: dict[str, Any]) -> None:
    data["stops"][1] |= {"earliest_s": 9.0, "latest_s": 5.0}


def _hurried(data: dict[str, Any]) -> None:
    data["vehicles"][0] |= {"ready_s": 2.0, "depart_by_s": 1.0}


def _back_before(data: dict[str, Any]) -> None:
    data["vehicles"][0] |= {"ready_s": 2.0, "return_by_s": 1.0}


def _half_parcel(data: dict[str, Any]) -> None:
    data["stops"][0]["demand"] = 0.5


def _nan(data: dict[str, Any]) -> None:
    data["stops"][0]["latest_s"] = float("nan")


def _depot_id(data: dict[str, Any]) -> None:
    data["stops"].append({"id": "depot", "node": "west"})


def _negative(data: dict[str, Any]) -> None:
    data["stops"][0]["service_s"] = -1


def _spelling(data: dict[str, Any]) -> None:
    data["vehicles"][0]["first_stopp"] = "c1"


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (_drop, "stops: "),
        (_unknown_node, "stops.c2.node: unknown node 'nowhere'"),
        (_depot_node, "depots.depot.node: unknown node 'nowhere'"),
        (_twice, "2 stops with id 'c1'"),
        (_vehicle_twice, "2 vehicles with id 'van-a'"),
        (_no_vehicles, "vehicles: "),
        (_missing_stop, "vehicles.van-a.first_stop: no stop 'c9'"),
        (_shared_stop, "2 vehicles with first_stop 'c1'"),
        (_depot_twice, "depots: 2 depots with id 'depot'"),
        (_missing_depot, "vehicles.van-b.depot: no depot 'north'; name one of the depots"),
        (_no_depots, "depots: "),
        (_closed_window, "stops.c2: latest_s (5) must not be below earliest_s (9)"),
        (_hurried, "vehicles.van-a: depart_by_s (1) must not be below ready_s (2)"),
        (_back_before, "vehicles.van-a: return_by_s (1) must not be below ready_s (2)"),
        (_half_parcel, "stops.c1.demand: "),
        (_nan, "stops.c1.latest_s: "),
        (_depot_id, "stops.depot: a stop has a depot's id"),
        (_negative, "stops.c1.service_s"),
        (_spelling, "vehicles.van-a.first_stopp: unknown key"),
    ],
)
def test_a_fleet_that_cannot_be_dispatched_is_named(
    demo: RoutingProblem, spoil: Callable[[dict[str, Any]], None], line: str
) -> None:
    """Each fault is one line with file, key, what is wrong and a mend."""
    data = demo_data()
    spoil(data)
    with pytest.raises(InputError) as caught:
        fleet_from(data, demo.network, "fleet.toml")
    assert str(caught.value).startswith("fleet.toml: ")
    assert line in str(caught.value)
    assert "; " in str(caught.value)


def test_vehicles_have_depots_of_their_own(demo: RoutingProblem) -> None:
    """A vehicle starts and ends at the depot it names, or else at the first one."""
    data = demo_data()
    data["depots"] = [{"id": "north", "node": "west"}, {"id": "south", "node": "depot"}]
    data["vehicles"][1]["depot"] = "south"
    fleet = fleet_from(data, demo.network, "fleet.toml")
    assert [fleet.depot_of(vehicle).id for vehicle in fleet.vehicles] == ["north", "south"]
    assert ("north", "c1") in fleet.legs(fleet.vehicles[0])
    assert ("south", "c3") in fleet.legs(fleet.vehicles[1])
    assert (fleet.node("north"), fleet.service_s("north"), fleet.node("c1")) == ("west", 0, "c1")


def test_what_can_be_routed_in_part_is_no_fault(demo: RoutingProblem) -> None:
    """Stops at one junction, a stop at the depot and vehicles without work are accepted."""
    data = demo_data()
    data["stops"] += [{"id": "c5", "node": "c1"}, {"id": "c6", "node": "depot"}]
    data["vehicles"] += [{"id": f"spare-{i}"} for i in range(9)]
    assert len(fleet_from(data, demo.network, "fleet.toml").pooled) == 4


@pytest.mark.parametrize(
    ("change", "obstacle"),
    [
        ({}, None),
        ({"stops": {"demand": 3}}, None),
        ({"vehicles": {"capacity": 3}}, None),
        ({"stops": {"demand": 1}, "vehicles": {"capacity": 3}}, None),
        ({"vehicles": {"depart_by_s": 9.0}}, None),
        ({"stops": {"demand": 1}, "vehicles": {"capacity": 2}}, "vehicle 'van-a' has a capacity"),
        ({"stops": {"latest_s": 9.0}}, "stop 'c1' has a time window"),
        ({"stops": {"earliest_s": 9.0}}, "stop 'c1' has a time window"),
        ({"vehicles": {"return_by_s": 900.0}}, "vehicle 'van-a' has to be back in time"),
        ({"vehicles": {"first_stop": None}}, None),
        ({"spare": 3}, "3 without a first stop are too many for 2 pooled stops"),
    ],
)
def test_what_the_arc_form_cannot_express_is_named(
    demo: RoutingProblem, change: dict[str, Any], obstacle: str | None
) -> None:
    """Windows, capacities that can bind and vehicles that must idle are obstacles, no more."""
    data = demo_data()
    for table in ("stops", "vehicles"):
        for row in data[table]:
            row |= change.get(table, {})
    data["vehicles"] += [{"id": f"spare-{i}"} for i in range(change.get("spare", 0))]
    found = arc_form_obstacle(fleet_from(data, demo.network, "fleet.toml"))
    assert found is None if obstacle is None else found is not None and obstacle in found


@pytest.mark.parametrize(
    ("text", "line"), [(None, "no such file"), ("[[depots", "not TOML"), ("", "missing key")]
)
def test_unreadable_files_are_named(
    demo: RoutingProblem, tmp_path: Path, text: str | None, line: str
) -> None:
    """A missing, malformed or empty fleet file is an InputError that names the file."""
    path = tmp_path / "fleet.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=line) as caught:
        load_fleet(path, demo.network)
    assert str(path) in str(caught.value)

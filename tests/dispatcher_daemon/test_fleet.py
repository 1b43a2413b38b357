from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dispatcher_daemon.fleet import Vehicle, fleet_from, load_fleet
from dispatcher_daemon.problem import RoutingProblem
from slipstream.errors import InputError
from slipstream.roads import Segment, build_network


def demo_data() -> dict[str, Any]:
    """The demo's fleet as plain data."""
    return {
        "depot": {"node": "depot"},
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
    data["depot"]["node"] = "nowhere"


def _twice(data: dict[str, Any]) -> None:
    data["stops"].append({"id": "c1", "node": "west"})


def _same_node(data: dict[str, Any]) -> None:
    data["stops"].append({"id": "c5", "node": "c1"})


def _vehicle_twice(data: dict[str, Any]) -> None:
    data["vehicles"].append({"id": "van-a"})


def _no_vehicles(data: dict[str, Any]) -> None:
    data["vehicles"] = []


def _missing_stop(data: dict[str, Any]) -> None:
    data["vehicles"][0]["first_stop"] = "c9"


def _shared_stop(data: dict[str, Any]) -> None:
    data["vehicles"][1]["first_stop"] = "c1"


def _idle(data: dict[str, Any]) -> None:
    data["vehicles"] += [{"id": f"spare-{i}"} for i in range(3)]


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
        (_depot_node, "depot.node: unknown node 'nowhere'"),
        (_twice, "2 stops with id 'c1'"),
        (_same_node, "2 stops with node 'c1'; merge"),
        (_vehicle_twice, "2 vehicles with id 'van-a'"),
        (_no_vehicles, "vehicles: "),
        (_missing_stop, "vehicles.van-a.first_stop: no stop 'c9'"),
        (_shared_stop, "2 vehicles with first_stop 'c1'"),
        (_idle, "vehicles: 3 vehicles without a first stop for 2 pooled stops"),
        (_depot_id, "depot: a stop has the depot's id"),
        (_negative, "stops.0.service_s"),
        (_spelling, "vehicles.0.first_stopp: unknown key"),
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


def test_unreachable_stop_is_named() -> None:
    """A stop that can be reached but not left again is refused before any cycle."""
    network = build_network(
        "dead end",
        [
            Segment("there", "depot", "c1", 100.0, 10.0, 1, ((0, 0), (1, 0))),
            Segment("trap", "c1", "c2", 100.0, 10.0, 1, ((1, 0), (2, 0))),
            Segment("back", "c1", "depot", 100.0, 10.0, 1, ((1, 0), (0, 0))),
        ],
        {"depot": (0, 0), "c1": (1, 0), "c2": (2, 0)},
    )
    data = {
        "depot": {"node": "depot"},
        "stops": [{"id": "a", "node": "c1"}, {"id": "b", "node": "c2"}],
        "vehicles": [{"id": "v"}],
    }
    with pytest.raises(InputError, match=r"stops\.b\.node: node 'c2' cannot be left for the depot"):
        fleet_from(data, network, "fleet.toml")


@pytest.mark.parametrize(
    ("text", "line"), [(None, "no such file"), ("[depot", "not TOML"), ("", "missing key")]
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

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import pyproj
import pytest

from dispatcher_daemon.fleet import Fleet, Vehicle, fleet_from, load_fleet, served
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.arc_form import arc_form_obstacle
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network
from slipstream.vehicle_types import PRESETS, VehicleType


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


def _named_as_break(data: dict[str, Any]) -> None:
    data["vehicles"][0]["breaks"] = [{"duration_s": 60.0}]
    data["stops"].append({"id": "van-a break 1", "node": "west"})


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
        (_named_as_break, "stops.van-a break 1: it has the name that a vehicle's break has"),
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


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"stops": {"carrier": "b"}},
            "stops.c1.carrier: no vehicle of carrier 'b'; give that carrier a vehicle",
        ),
        ({"stops": {"carrier": ""}}, "stops.c1.carrier: "),
        (
            {"stops": {"skills": ["lift", "cold"]}, "vehicles": {"skills": ["lift"]}},
            "stops.c1.skills: no vehicle has all the skills lift, cold; give a vehicle what",
        ),
        ({"stops": {"vehicle": "w"}}, "stops.c1.vehicle: no vehicle 'w'; name one of"),
        (
            {"vehicles": {"first_stop": "c1"}, "stops": {"skills": ["lift"]}},
            "stops.c1.skills: no vehicle has all the skills lift",
        ),
        (
            {"vehicles": {"carrier": "a", "first_stop": "c1"}, "stops": {"carrier": "b"}},
            "vehicles.v.first_stop: stop 'c1' is of carrier 'b', and the vehicle is not",
        ),
        (
            {"vehicles": {"ready_s": 90, "depart_by_s": 60}},
            "vehicles.v: depart_by_s (60) must not be below ready_s (90)",
        ),
        (
            {"vehicles": {"ready_s": 90, "return_by_s": 60}},
            "vehicles.v: return_by_s (60) must not be below ready_s (90)",
        ),
        (
            {"stops": {"earliest_s": 90, "latest_s": 60}},
            "stops.c1: latest_s (60) must not be below earliest_s (90)",
        ),
        ({"stops": {"earliest_s": -1}}, "stops.c1.earliest_s: "),
        ({"stops": {"latest_s": -1}}, "stops.c1.latest_s: "),
        ({"vehicles": {"ready_s": -1}}, "vehicles.v.ready_s: "),
        ({"vehicles": {"depart_by_s": -1}}, "vehicles.v.depart_by_s: "),
        ({"vehicles": {"return_by_s": -1}}, "vehicles.v.return_by_s: "),
    ],
)
def test_carriers_and_times_that_cannot_be_are_named(
    change: dict[str, dict[str, object]], said: str
) -> None:
    """A carrier without vehicles, windows that contradict each other, times before now: one line
    with file, key and mend.
    """
    data: dict[str, Any] = {
        "depots": [{"node": "depot"}],
        "stops": [{"id": "c1", "node": "c1", **change.get("stops", {})}],
        "vehicles": [
            {"id": "v", **change.get("vehicles", {})},
            *([{"id": "w", "carrier": "b"}] if "first_stop" in change.get("vehicles", {}) else []),
        ],
    }
    with pytest.raises(InputError) as error:
        fleet_from(data, load_network("demo"), "fleet.toml")
    text = str(error.value)
    assert text.startswith(f"fleet.toml: {said}")
    assert "; " in text
    assert "\n" not in text


def _typed(**vehicle: object) -> dict[str, object]:
    return {
        "depots": [{"node": "depot", "charging_power_kw": 22}],
        "stops": [{"id": "c1", "node": "c1", "mass_kg": 900}, {"id": "c2", "node": "c2"}],
        "charging_stops": [{"id": "fast", "node": "c3", "power_kw": 150}],
        "vehicle_types": [{"id": "high-van", "preset": "van", "height_m": 3.1}],
        "vehicles": [{"id": "v", **vehicle}],
    }


def test_a_vehicle_has_a_preset_a_type_of_the_fleet_or_data_of_its_own() -> None:
    """Or none: then it is the paper's car, with no battery to look at."""
    network = load_network("demo")

    def kind(**vehicle: object) -> VehicleType | None:
        fleet = fleet_from(_typed(**vehicle), network, "f.toml")
        return fleet.type_of(fleet.vehicles[0])

    assert kind() is None
    assert kind(type="truck_40t") == PRESETS["truck_40t"]
    high = kind(type="high-van")
    assert high is not None
    assert (high.height_m, high.mass_kg) == (3.1, PRESETS["van"].mass_kg)
    own = kind(own_type={"preset": "van", "max_speed_mps": 22.0}, charge_kwh=30.0)
    assert own is not None
    assert (own.max_speed_mps, own.battery_kwh) == (22.0, 35.0)


@pytest.mark.parametrize(
    ("vehicle", "said"),
    [
        ({"type": "lorry"}, "vehicles.v.type: no vehicle type 'lorry'"),
        ({"type": "van", "own_type": {}}, "give type or own_type"),
        ({"charge_kwh": 3}, "vehicles.v.charge_kwh: a charge without a battery"),
        ({"type": "van", "charge_kwh": 36}, "36 kWh in a battery of 35 kWh"),
        ({"own_type": {"preset": "van", "mass_kg": 0}}, "mass_kg"),
        ({"own_type": {"braking": {"preset": "tram"}}}, "vehicles.v.own_type.braking.preset"),
        ({"own_type": {"braking": {"dead_s": -1}}}, "vehicles.v.own_type.braking.dead_s"),
    ],
)
def test_a_vehicles_data_are_checked(vehicle: dict[str, object], said: str) -> None:
    """One line that names the key."""
    with pytest.raises(InputError) as error:
        fleet_from(_typed(**vehicle), load_network("demo"), "f.toml")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("table", "row", "said"),
    [
        ("charging_stops", {"id": "x", "node": "nowhere", "power_kw": 1}, "unknown node 'nowhere'"),
        ("charging_stops", {"id": "c1", "node": "c1", "power_kw": 1}, "has a stop's id"),
        ("charging_stops", {"id": "x", "node": "c1", "power_kw": 0}, "power_kw"),
        ("vehicle_types", {"id": "van"}, "a preset's id"),
        (
            "vehicle_types",
            {"id": "w", "braking": {"error": 1}},
            r"types\.w\.braking\.error: 1.* give",
        ),
        ("hubs", {"id": "rest", "node": "nowhere"}, "unknown node 'nowhere'"),
        ("hubs", {"id": "c1", "node": "c1"}, "has a stop's id"),
    ],
)
def test_charging_stops_hubs_and_types_are_checked(
    table: str, row: dict[str, object], said: str
) -> None:
    """As stops and vehicles are."""
    with pytest.raises(InputError, match=said):
        fleet_from({**_typed(), table: [row]}, load_network("demo"), "f.toml")


def test_a_load_is_limited_by_capacity_and_payload() -> None:
    """By whichever is less; the paper's car has no payload that is known."""
    network = load_network("demo")
    fleet = fleet_from(_typed(type="van"), network, "f.toml")
    van, (heavy, light) = fleet.vehicles[0], fleet.stops
    assert fleet.overload(van, [heavy, light]) is None
    assert fleet.overload(van, [heavy, heavy]) == "1800 kg, more than its payload of 1045 kg"
    small = van.model_copy(update={"capacity": 1})
    full = light.model_copy(update={"demand": 2})
    assert fleet.overload(small, [full]) == "2, more than its capacity of 1"
    assert fleet_from(_typed(), network, "f").overload(Vehicle(id="car"), [heavy] * 9) is None


def test_the_arc_form_has_one_type_and_no_battery() -> None:
    """All vehicles share its paths, and nothing counts charge."""
    network = load_network("demo")
    data = _typed()
    data["vehicles"] = [{"id": "a"}, {"id": "b", "own_type": {"mass_kg": 2000}}]
    assert "different types" in str(arc_form_obstacle(fleet_from(data, network, "f")))
    data["vehicles"] = [{"id": "a", "type": "van"}]
    assert "battery" in str(arc_form_obstacle(fleet_from(data, network, "f")))
    data["vehicles"] = [{"id": "a", "type": "paper_car"}, {"id": "b"}]
    assert arc_form_obstacle(fleet_from(data, network, "f")) is None


def test_the_arc_form_is_of_one_carrier() -> None:
    """It has no account of what each has, and every vehicle may serve every pooled stop."""
    network = load_network("demo")
    data = _typed()
    data["stops"] = [{"id": "c1", "node": "c1", "carrier": "a"}, {"id": "c2", "node": "c2"}]
    data["vehicles"] = [{"id": "a", "carrier": "a"}, {"id": "b", "carrier": "a"}]
    assert arc_form_obstacle(fleet_from(data, network, "f")) is None
    data["vehicles"] = [{"id": "a", "carrier": "a"}, {"id": "b"}]
    assert "different carriers" in str(arc_form_obstacle(fleet_from(data, network, "f")))
    fleet = fleet_from(data, network, "f")
    others = Fleet(depots=fleet.depots, stops=fleet.stops, vehicles=fleet.vehicles[1:])
    assert "'c1' is of another carrier" in str(arc_form_obstacle(others))


TROY = Path(
    str(resources.files("slipstream_lab.simulation.scenarios") / "data/troy/troy.net.xml.gz")
)


@pytest.fixture(scope="module")
def troy() -> RoadNetwork:
    """A network with a projection."""
    return load_network(TROY)


def _located(**stop: object) -> dict[str, object]:
    return {
        "depots": [{"lat": 42.7284, "lon": -73.6918}],
        "stops": [{"id": "s", **stop}],
        "vehicles": [{"id": "v"}],
    }


def test_places_by_latitude_and_longitude_are_snapped_to_the_road(
    troy: RoadNetwork, caplog: pytest.LogCaptureFixture
) -> None:
    """A point beside a road is served at its nearer end; how far it lies is said."""
    segment = max(troy.segments.values(), key=lambda s: s.length_m)
    (x0, y0), (x1, y1) = segment.shape[:2]
    assert troy.projection is not None
    x, y = (0.8 * x0 + 0.2 * x1 - troy.projection.offset_m[0], 0.8 * y0 + 0.2 * y1)
    y -= troy.projection.offset_m[1]
    lon, lat = pyproj.Proj(troy.projection.parameter)(x, y, inverse=True)
    with caplog.at_level(logging.INFO):
        fleet = fleet_from(_located(lat=lat, lon=lon), troy, "f.toml")
    assert fleet.stops[0].node in (segment.start, segment.end)
    assert fleet.depots[0].node in troy.junctions
    assert "of all places the furthest off" in caplog.text
    found = {place.key: place for place in served(fleet, troy)}
    road = found["stops.s"].road
    assert road is not None
    assert road.distance_m == pytest.approx(0.0, abs=0.1)
    assert found["stops.s"].to_node_m == pytest.approx(
        math.dist(troy.junctions[fleet.stops[0].node], (0.8 * x0 + 0.2 * x1, 0.8 * y0 + 0.2 * y1))
    )
    assert found["depots.depot"].node == fleet.depots[0].node
    again = fleet_from(fleet.model_dump(), troy, "again")
    assert again == fleet


@pytest.mark.parametrize(
    ("stop", "said"),
    [
        ({"lat": 42.9, "lon": -73.6}, "m from the nearest road that its vehicles may use"),
        ({"lat": 42.7284}, "give lat and lon"),
        ({"lat": 91.0, "lon": 0.0}, "lat"),
        ({"lat": "north", "lon": 0.0}, "lat"),
        ({}, "node"),
    ],
)
def test_a_place_that_is_none_is_one_line(
    troy: RoadNetwork, stop: dict[str, object], said: str
) -> None:
    """With the file, the key and the mend."""
    with pytest.raises(InputError) as error:
        fleet_from(_located(**stop), troy, "f.toml")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_network_without_a_projection_says_so() -> None:
    """The built-in one has none."""
    with pytest.raises(InputError, match="knows no latitude and longitude"):
        fleet_from(_located(node="c1"), load_network("demo"), "f.toml")

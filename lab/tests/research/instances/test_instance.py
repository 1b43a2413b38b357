from __future__ import annotations

import json
import tempfile
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.routes.servability import unservable
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.energy.consumption import VehicleParameters
from slipstream.energy.drive import DrivingStyle
from slipstream.errors import InputError
from slipstream.roads.access import Access
from slipstream.roads.sumo_net import load_network
from slipstream_lab.research.cities.generator import generate_city, small_city
from slipstream_lab.research.instances.instance import (
    Instance,
    Optimum,
    instance_from,
    instance_schema,
    load_instance,
    write_instance,
)

DATA = Path(__file__).resolve().parents[4] / "slipstream" / "data"


def plain() -> dict[str, Any]:
    """A small instance as plain data: a there-and-back road with a signal at its far end."""
    return {
        "format": "slipstream-instance/1",
        "name": "small",
        "network": {
            "junctions": [
                {"id": "a", "x_m": 0.0, "y_m": 0.0},
                {"id": "b", "x_m": 900.0, "y_m": 0.0, "signal": True},
            ],
            "segments": [
                {"id": "ab", "start": "a", "end": "b", "length_m": 900.0, "speed_limit_mps": 14.0},
                {"id": "ba", "start": "b", "end": "a", "length_m": 900.0, "speed_limit_mps": 14.0},
            ],
        },
        "fleet": {
            "depots": [{"id": "yard", "node": "a"}],
            "stops": [{"id": "s", "node": "b"}],
            "vehicles": [{"id": "v"}],
        },
        "traffic": {"segments": [{"segment": "ab", "y_e": 1, "speed_mps": 12.5}]},
        "optimum": {
            "form": "arc",
            "objective_kwh": 0.2,
            "proven": True,
            "method": "by hand",
            "routes": [{"vehicle": "v", "stops": ["s"]}],
        },
    }


def rich(demo: RoutingProblem, snapshot: TrafficSnapshot) -> Instance:
    """The demo with data of its own wherever a file may give some."""
    problem = replace(
        demo, vehicle=VehicleParameters(mass_kg=2400.1), style=DrivingStyle(1.1, 0.1 + 0.2)
    )
    routes = {"van-a": ("c1", "c2"), "van-b": ()}
    optimum = Optimum("route", 1 / 3, False, "tabu", routes)
    return Instance("rich", problem, snapshot, "Länge „übermäßig“\n\\ 'x'", optimum, 2.5)


def on_roads_alone(problem: RoutingProblem) -> RoutingProblem:
    """Without what only agents need of the roads, which instances do not keep."""
    network = replace(problem.network, crossings=MappingProxyType({}), projection=None)
    return replace(problem, network=network)


@pytest.mark.parametrize("suffix", ["json", "toml"])
def test_what_is_written_is_read_back_exactly(
    demo: RoutingProblem, traffic: Callable[..., TrafficSnapshot], tmp_path: Path, suffix: str
) -> None:
    """Roads, fleet, traffic, vehicle, style and optimum survive, to the last bit of each number."""
    flags = traffic(avenue_east=1, avenue_west=0, mill_street_east=None)
    segments = {
        **demo.network.segments,
        "avenue_east": replace(
            demo.network.segments["avenue_east"],
            access=Access(
                frozenset({"passenger", "delivery"}), 3.8, None, 12.0, 7500.0, {"delivery": 22.2}
            ),
        ),
    }
    turn = next((a, b) for a, onto in demo.network.follows.items() for b in onto)
    network = replace(
        demo.network, segments=segments, turn_classes={turn: frozenset({"bus", "taxi"})}
    )
    demo = on_roads_alone(replace(demo, network=network))
    wanted = rich(demo, TrafficSnapshot(flags.now_ns, flags.segments, ()))
    path = tmp_path / f"rich.{suffix}"
    write_instance(wanted, path)
    assert load_instance(path) == wanted
    first = path.read_bytes()
    write_instance(load_instance(path), path)
    assert path.read_bytes() == first


@pytest.mark.parametrize("suffix", ["json", "toml"])
def test_a_generated_city_is_read_back_exactly(tmp_path: Path, suffix: str) -> None:
    """Windows, capacities, several depots and forbidden turns of a city survive."""
    made = generate_city(3, vehicles=12, stops=40, segments=160)
    city = Instance("city", made.problem, made.snapshot)
    write_instance(city, tmp_path / f"city.{suffix}")
    assert load_instance(tmp_path / f"city.{suffix}") == city


@pytest.mark.long
@given(
    length=st.floats(min_value=1e-300, max_value=1e6),
    x=st.floats(-1e8, 1e8),
    provenance=st.text(max_size=50).filter(lambda t: t.isprintable() or "\n" in t),
)
def test_any_number_and_text_survives(length: float, x: float, provenance: str) -> None:
    """No float loses a bit and no text a character on its way through JSON and TOML."""
    data = plain() | {"provenance": provenance}
    data["network"]["segments"][0]["length_m"] = length
    data["network"]["junctions"][0]["x_m"] = x
    instance = instance_from(data, "x.json")
    with tempfile.TemporaryDirectory() as folder:
        for suffix in ("json", "toml"):
            path = Path(folder) / f"x.{suffix}"
            write_instance(instance, path)
            assert load_instance(path) == instance


def test_a_file_says_little_and_defaults_fill_the_rest() -> None:
    """Straight shapes, turns but the U-turn, free flow where no row is, and the paper's car."""
    instance = instance_from(plain(), "small.json")
    network, traffic = instance.problem.network, instance.snapshot.segments
    assert network.segments["ab"].shape == ((0.0, 0.0), (900.0, 0.0))
    assert network.follows == {"ab": (), "ba": ()}
    assert network.signals == {"b"}
    assert (traffic["ab"].open, traffic["ab"].reason, traffic["ab"].speed_mps) == (True, None, 12.5)
    assert (traffic["ba"].open, traffic["ba"].reason) == (False, "unwatched")
    assert traffic["ba"].speed_mps == 14.0
    assert instance.problem.vehicle == VehicleParameters()
    assert instance.sync_window_s == 3.0


def test_expected_stops_come_from_data_only() -> None:
    """Signals cost nothing unless the file says so; then each segment that ends at one does."""
    data = plain()
    assert {t.stops for t in instance_from(data, "x").snapshot.segments.values()} == {0.0}
    data["traffic"]["stops_at_signals"] = 0.6
    stops = {t.segment: t.stops for t in instance_from(data, "x").snapshot.segments.values()}
    assert stops == {"ab": 0.6, "ba": 0.0}
    data["traffic"]["segments"][0]["stops"] = 0.25
    assert instance_from(data, "x").snapshot.segments["ab"].stops == 0.25


def test_a_flag_gates_and_a_reason_closes() -> None:
    """y_e = 1 opens a gate, 0 and unknown keep it closed, and a reason closes one all the same."""

    def gate(**row: object) -> tuple[bool, str | None]:
        data = plain()
        data["traffic"]["segments"] = [{"segment": "ab", **row}]
        judged = instance_from(data, "x").snapshot.segments["ab"]
        return judged.open, judged.reason

    assert gate(y_e=1) == (True, None)
    assert gate(y_e=1, reason="stale") == (False, "stale")
    assert gate(y_e=0) == (False, "turbulent")
    assert gate() == (False, "unwatched")
    assert gate(reason="uncertain") == (False, "uncertain")


def test_roads_may_come_from_a_sumo_net_beside_the_file(tmp_path: Path) -> None:
    """A relative path counts from the instance's folder; written again, the roads are inside."""
    (tmp_path / "roads").mkdir()
    net = tmp_path / "roads" / "town.net.xml"
    net.write_bytes((DATA / "demo.net.xml").read_bytes())
    data = plain() | {"network": {"sumo_net": "roads/town.net.xml"}, "traffic": {}}
    data["fleet"] |= {
        "depots": [{"id": "yard", "node": "depot"}],
        "stops": [{"id": "s", "node": "c1"}],
    }
    path = tmp_path / "town.json"
    path.write_text(json.dumps(data))
    instance = load_instance(path)
    assert instance.problem.network == replace(load_network("demo"), name="town")
    write_instance(instance, path)
    net.unlink()
    assert load_instance(path) == replace(instance, problem=on_roads_alone(instance.problem))


def test_a_gate_that_says_two_things_is_not_written(tmp_path: Path) -> None:
    """An open gate without y_e = 1 is nobody's traffic."""
    city = small_city(1)
    name, state = next(iter(city.snapshot.segments.items()))
    wrong = {**city.snapshot.segments, name: replace(state, y_e=0, open=True, reason=None)}
    snapshot = replace(city.snapshot, segments=MappingProxyType(wrong))
    with pytest.raises(ValueError, match=name):
        write_instance(Instance("x", city.problem, snapshot), tmp_path / "x.json")
    with pytest.raises(InputError, match=r"x\.xml: neither \.json nor \.toml; rename it"):
        write_instance(Instance("x", city.problem, city.snapshot), tmp_path / "x.xml")


def put(path: str, value: object) -> Callable[[dict[str, Any]], None]:
    """Set what a dotted path points at; a path that ends in + appends."""

    def spoil(data: Any) -> None:
        *way, last = path.split(".")
        for part in way:
            data = data[int(part)] if isinstance(data, list) else data[part]
        if last == "+":
            data.append(value)
        elif isinstance(data, list):
            data[int(last)] = value
        else:
            data[last] = value

    return spoil


NAN, INF = float("nan"), float("inf")
SEGMENT = "network.segments.ab"


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("network.segments.0.length_m", NAN, f"{SEGMENT}.length_m: nan is no number"),
        ("network.segments.0.length_m", INF, f"{SEGMENT}.length_m: inf is no number"),
        ("network.segments.0.length_m", -5.0, f"{SEGMENT}.length_m: -5.0 is not above 0"),
        ("network.segments.0.length_m", 0, f"{SEGMENT}.length_m: 0 is not above 0"),
        ("network.segments.0.length_m", "9", f"{SEGMENT}.length_m: '9' is no number"),
        ("network.segments.0.speed_limit_mps", -1, f"{SEGMENT}.speed_limit_mps: "),
        ("network.segments.0.speed_limit_mps", 1e200, f"{SEGMENT}.speed_limit_mps: "),
        ("network.segments.0.length_m", 10**400, f"{SEGMENT}.length_m: "),
        ("network.segments.0.lanes", 0, f"{SEGMENT}.lanes: "),
        ("network.segments.0.end", "z", f"{SEGMENT}: unknown junction 'z'; add it"),
        ("network.segments.1.id", "ab", f"{SEGMENT}: two segments with this id; rename one"),
        ("network.segments.0.shape", [[0.0, 0.0]], f"{SEGMENT}.shape: "),
        ("network.junctions.1.id", "a", "network.junctions.a: two junctions with this id"),
        ("network.junctions.0.x_m", NAN, "network.junctions.a.x_m: nan is no number"),
        ("network.turns", [{"segment": "ab", "onto": ["zz"]}], "unknown segment 'zz'"),
        ("network.turns", [{"segment": "ab", "onto": ["ab"]}], "begins elsewhere"),
        ("network.turns", [{"segment": "zz", "onto": []}], "unknown segment 'zz'"),
        ("network.segments", [], "network: give either sumo_net, or junctions and segments"),
        ("network.sumo_net", "demo", "network: give either sumo_net, or junctions and segments"),
        ("network", {"sumo_net": "none.net.xml"}, "none.net.xml: no such file"),
        ("fleet.stops", [], "fleet: stops must not be empty"),
        ("fleet.vehicles", [], "fleet.vehicles: "),
        ("fleet.depots", [], "fleet.depots: "),
        ("fleet.stops.+", {"id": "s", "node": "a"}, "fleet.stops: 2 stops with id 's'; rename"),
        ("fleet.vehicles.+", {"id": "v"}, "fleet.vehicles: 2 vehicles with id 'v'; rename"),
        ("fleet.depots.+", {"id": "yard", "node": "b"}, "fleet.depots: 2 depots with id 'yard'"),
        ("fleet.stops.+", {"id": "yard", "node": "b"}, "fleet.stops.yard: a stop has a depot's"),
        ("fleet.stops.0.node", "z", "fleet.stops.s.node: unknown node 'z'; use a junction of"),
        ("fleet.depots.0.node", "z", "fleet.depots.yard.node: unknown node 'z'"),
        ("fleet.stops.0.demand", -1, "fleet.stops.s.demand: "),
        ("fleet.stops.0.latest_s", -1.0, "fleet.stops.s.latest_s: "),
        ("fleet.stops.0.earliest_s", NAN, "fleet.stops.s.earliest_s: "),
        ("fleet.vehicles.0.capacity", -2, "fleet.vehicles.v.capacity: "),
        ("fleet.vehicles.0.depot", "z", "fleet.vehicles.v.depot: no depot 'z'; name one of"),
        ("fleet.vehicles.0.first_stop", "z", "fleet.vehicles.v.first_stop: no stop 'z'"),
        ("fleet.vehicles.0.speed", 3, "fleet.vehicles.v.speed: unknown key"),
        ("traffic.segments.0.segment", "zz", "traffic.segments.zz: unknown segment; use"),
        ("traffic.segments.+", {"segment": "ab"}, "traffic.segments.ab: two rows for this segment"),
        ("traffic.segments.0.speed_mps", 14.1, "traffic.segments.ab.speed_mps: 14.1 is above"),
        ("traffic.segments.0.speed_mps", 0.0, "traffic.segments.ab.speed_mps: "),
        ("traffic.segments.0.y_e", 2, "traffic.segments.ab.y_e: "),
        ("traffic.segments.0.stops", -0.1, "traffic.segments.ab.stops: "),
        ("traffic.stops_at_signals", NAN, "traffic.stops_at_signals: "),
        ("traffic.now_ns", -1, "traffic.now_ns: "),
        ("vehicle", {"mass_kg": 0.0}, "vehicle.mass_kg: 0.0 is not above 0"),
        ("vehicle", {"mass": 1800.0}, "vehicle.mass: unknown key"),
        ("vehicle", {"powertrain_efficiency": 1.1}, "vehicle.powertrain_efficiency: "),
        ("vehicle", {"mass_kg": 1e300}, "vehicle.mass_kg: 1e+300 is above"),
        ("style", {"braking_mps2": -1.0}, "style.braking_mps2: "),
        ("style", {"acceleration_mps2": 1e-300}, "style.acceleration_mps2: "),
        ("sync_window_s", NAN, "sync_window_s: "),
        ("optimum.objective_kwh", INF, "optimum.objective_kwh: "),
        ("optimum.routes.0.vehicle", "w", "optimum.routes.w: unknown vehicle"),
        ("optimum.routes.0.stops", ["z"], "optimum.routes.v: no stop 'z'"),
        ("optimum.routes.+", {"vehicle": "v"}, "optimum.routes.v: two routes of this vehicle"),
        ("format", "slipstream-instance/9", "format: "),
        ("name", "", "name: "),
        ("nmae", "x", "nmae: unknown key; did you mean name?"),
    ],
)
def test_bad_input_is_one_line_with_file_key_and_mend(
    tmp_path: Path, path: str, value: object, line: str
) -> None:
    """Each fault in a file is named where it is, with what to do about it."""
    data = plain()
    put(path, value)(data)
    file = tmp_path / "bad.json"
    file.write_text(json.dumps(data))
    with pytest.raises(InputError) as caught:
        load_instance(file)
    said = str(caught.value)
    assert line in said
    assert "\n" not in said
    assert "; " in said
    assert said.startswith(str(file)) or "none.net.xml" in line


@pytest.mark.parametrize(
    ("name", "content", "line"),
    [
        ("x.json", None, "no such file; check the path"),
        ("x.toml", None, "no such file; check the path"),
        ("x.json", b"", "not JSON: "),
        ("x.json", b"{", "not JSON: "),
        ("x.json", b"\xff\xfe{}", "not JSON: "),
        ("x.json", b'{"name": "a", "name": "b"}', "key 'name' is given twice"),
        ("x.json", b"[" * 100_000, "nested too deeply"),
        ("x.json", b"[]", ""),
        ("x.json", b"{}", "missing key"),
        ("x.toml", b"[network", "not TOML: "),
        ("x.toml", b"a = " + b"[" * 50_000, "nested too deeply"),
        ("x.toml", b"", "missing key"),
    ],
)
def test_what_is_no_instance_file_is_refused(
    tmp_path: Path, name: str, content: bytes | None, line: str
) -> None:
    """A missing, broken or foreign file is one line that names it."""
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load_instance(path)
    assert str(caught.value).startswith(str(path))
    assert line in str(caught.value)


def test_what_can_be_routed_in_part_is_read() -> None:
    """Unreachable stops, too much demand and windows that cannot be met are listed, not refused."""
    data = plain()
    data["network"]["junctions"].append({"id": "island", "x_m": 5.0, "y_m": 5.0})
    data["fleet"]["stops"] += [
        {"id": "apart", "node": "island"},
        {"id": "heavy", "node": "b", "demand": 90},
        {"id": "late", "node": "b", "latest_s": 5.0},
    ]
    data["fleet"]["vehicles"][0]["capacity"] = 10
    instance = instance_from(data, "x.json")
    assert list(unservable(instance.problem, instance.snapshot)) == ["apart", "heavy", "late"]


def test_the_schema_names_every_key_and_its_bounds() -> None:
    """The published schema is what the reader checks by."""
    schema = instance_schema()
    assert set(plain()) <= set(schema["properties"])
    assert schema["additionalProperties"] is False
    segment = schema["$defs"]["SegmentRow"]["properties"]["length_m"]
    assert (segment["type"], segment["exclusiveMinimum"], segment["maximum"]) == ("number", 0, 1e6)
    assert schema["$defs"]["VehicleParameters"]["properties"]["mass_kg"]["default"] == 1800.0
    json.dumps(schema)


def test_the_example_in_the_docs_is_sound() -> None:
    """What docs/instances.md shows is an instance that can be read and served."""
    text = (Path(__file__).resolve().parents[4] / "docs" / "instances.md").read_text()
    example = text.split("```toml\n")[1].split("```")[0]
    instance = instance_from(tomllib.loads(example), "docs/instances.md")
    assert unservable(instance.problem, instance.snapshot) == {}
    assert instance.snapshot.segments["out"].stops == 0.4

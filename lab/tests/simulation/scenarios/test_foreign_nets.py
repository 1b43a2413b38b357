"""Nets and routes that others have made."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from lab.tests.simulation.scenarios import foreign
from slipstream.errors import InputError
from slipstream.osm.netconvert import find_netconvert
from slipstream.roads import RoadNetwork, Segment, build_network
from slipstream.roads.access import Access
from slipstream_cli.main import main
from slipstream_lab.simulation.rsus import load_rsus
from slipstream_lab.simulation.scenarios.networks.network import cut_network, largest_part
from slipstream_lab.simulation.scenarios.networks.route_files import (
    check_routes,
    count_passages,
    has_fleet_type,
)
from slipstream_lab.simulation.scenarios.scenario import load_scenario, prepare
from slipstream_lab.simulation.sumo import TYPES


@pytest.fixture(scope="module")
def town(
    made_once: Callable[[str, Callable[[Path], object]], Path], tool: Callable[[str], str]
) -> Path:
    """The configuration of a town that others have made; skipped without netconvert."""
    if find_netconvert() is None:
        tool("netconvert")
    return made_once("foreign", foreign.build) / "town.sumocfg"


def _roads(**closed: Access) -> RoadNetwork:
    """A ring a-b-c-a, a short cut c-d-a, a part e-f apart; all roads 100 m at 10 m/s."""
    names = ("ab", "bc", "ca", "cd", "da", "ef", "fe")
    places = {name: (100.0 * i, 0.0) for i, name in enumerate("abcdef")}
    segments = [
        Segment(
            n, n[0], n[1], 100.0, 10.0, 1, (places[n[0]], places[n[1]]), closed.get(n, Access())
        )
        for n in names
    ]
    return build_network("roads", segments, places, signals=["a"])


def test_the_largest_part_is_that_of_cars() -> None:
    """Roads and turns that a car may not use connect nothing, however long they are."""
    assert set(largest_part(_roads(), "x").segments) == {"ab", "bc", "ca", "cd", "da"}
    buses = Access(classes=frozenset({"bus"}))
    assert set(largest_part(_roads(cd=buses), "x").segments) == {"ab", "bc", "ca"}
    turns = {("bc", "cd"): frozenset({"bus"})}
    part = largest_part(replace(_roads(), turn_classes=turns), "x")
    assert set(part.segments) == {"ab", "bc", "ca"}
    for closed in (("ab", "ef"), _roads().segments):
        with pytest.raises(InputError, match="no two segments lead to each other by car"):
            largest_part(_roads(**dict.fromkeys(closed, buses)), "x")


def test_vehicles_without_a_route_count_on_their_quickest_way(tmp_path: Path) -> None:
    """Trips, flows and routes by name or inside; what drives outside the part counts nowhere."""
    path = tmp_path / "x.rou.xml"
    path.write_text(
        '<routes><route id="r" edges="ef fe"/><vehicle id="1" depart="0" route="r"/>'
        '<trip id="2" depart="0" from="bc" to="ab"/>'
        '<flow id="3" begin="0" end="1800" vehsPerHour="20" from="bc" to="da"/>'
        '<vehicle id="4" depart="9"><route edges="da ab"/></vehicle></routes>'
    )
    counted = count_passages((path,), largest_part(_roads(), "x"))
    assert counted == {"bc": 11, "ca": 1, "ab": 2, "cd": 10, "da": 11}


def test_a_type_named_as_the_fleets_is_refused_unless_it_is_the_fleets(tmp_path: Path) -> None:
    """The route files that scenarios write have the type, and can be given back."""
    path = tmp_path / "x.rou.xml"
    vehicle = '<vehicle id="v" depart="0"><route edges="ab"/></vehicle>'
    path.write_text(f'<routes><vType id="cav" vClass="bus"/>{vehicle}</routes>')
    with pytest.raises(InputError, match="cav: a vehicle type 'cav': that is the fleet's"):
        check_routes((path,), ["ab"])
    path.write_text(f"<routes>{TYPES['cav'].xml()}{vehicle}</routes>")
    check_routes((path,), ["ab"])
    assert has_fleet_type((path,))
    path.write_text(path.read_text().replace('"v"', '"cav/1"'))
    with pytest.raises(InputError, match="begins with 'cav/'"):
        check_routes((path,), ["ab"])


def test_what_a_town_of_others_leaves_out_is_counted(town: Path) -> None:
    """The island is not connected, the buses' road is closed to cars; the rest is used."""
    network, left_out = cut_network(town.parent / "town.net.xml")
    assert len(network.segments) == 8
    assert left_out is not None
    assert (left_out.unconnected, left_out.closed, left_out.of) == (2, 2, 12)
    assert "4 of 12 edges are left out" in str(left_out)


def test_rsus_of_a_town_of_others_stand_where_its_traffic_is(town: Path, tmp_path: Path) -> None:
    """Without an RSU file, on approaches that its vehicles use, in the connected part."""
    folder = town.parent
    routes = (folder / "cars.rou.xml", folder / "others.rou.xml")
    scenario = load_scenario(
        "town",
        net=folder / "town.net.xml",
        routes=routes,
        additional=(folder / "types.add.xml", folder / "detectors.add.xml"),
    )
    background = prepare(scenario, 1, tmp_path)
    assert background.files == routes
    watched = {stretch.segment for rsu in background.rsus for stretch in rsu.watch}
    assert watched
    assert watched <= set(count_passages(routes, scenario.network))
    assert 'file="NUL"' in background.additional[1].read_text()


@pytest.mark.nightly
@pytest.mark.process
def test_a_town_of_others_is_evaluated_by_its_configuration(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Baseline and every lever drive in it, though its own traffic leaves the connected part; what
    is left out and not taken over is told, and nothing is written beside its files.
    """
    before = sorted(path.name for path in town.parent.iterdir())
    options = ("--sumocfg", str(town), "--seeds", "1", "--arms", "B,C", "--workers", "1")
    assert main(["evaluate", *options, "--out", str(tmp_path / "out"), "--json"]) == 0
    captured = capsys.readouterr()
    summary = json.loads(captured.out)
    assert list(summary["arms"]) == ["B", "C"]
    arms = [json.loads(path.read_text()) for path in (tmp_path / "out" / "arms").glob("*.json")]
    for arm in arms:
        result = arm["result"]
        assert (result["begin_s"], result["end_s"]) == (3600.0, 4200.0)
        assert result["legs"]
        assert result["others"]["arrived"] > 20
    assert "4 of 12 edges are left out" in captured.err
    assert "not taken over: time-to-teleport" in captured.err
    assert sorted(path.name for path in town.parent.iterdir()) == before


@pytest.mark.process
@pytest.mark.long
def test_a_town_of_others_is_shown_by_the_rsu_file_of_the_evaluation(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One file for all commands: with a camera of its own, or one beside the road."""
    rsus = tmp_path / "rsus.toml"
    rsus.write_text(
        '[[rsus]]\nid = "south"\n'
        'watch = [{ segment = "7+8", from_m = 300.0, to_m = 500.0 }]\n'
        '[[rsus]]\nid = "north"\n'
        'watch = [{ segment = "12#0", from_m = 400.0, to_m = 440.0 }]\n'
        "mast = { x_m = 240.0, y_m = 410.0 }\n"
        "view = { look_at_m = [180.0, 402.0], width_px = 480, height_px = 270 }\n"
    )
    network = cut_network(town.parent / "town.net.xml")[0]
    assert [rsu.id for rsu in load_rsus(rsus, network)] == ["south", "north"]
    clip = ("clip", "sumo", "--sumocfg", str(town), "--rsu", str(rsus), "--out", str(tmp_path))
    short = ("--seconds", "0.2", "--fps", "10", "--begin", "3660")
    assert main([*clip, *short]) == 2
    assert "several RSUs; name one: south, north" in capsys.readouterr().err
    for rsu, segment in (("south", "7+8"), ("north", "12#0")):
        assert main([*clip, *short, "--rsu-id", rsu]) == 0
        assert f'id = "{segment}"' in (tmp_path / "camera.toml").read_text()

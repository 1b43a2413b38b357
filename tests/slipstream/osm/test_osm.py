"""OpenStreetMap extracts: read in every form, turned into a net, and what is left out is told."""

from __future__ import annotations

import bz2
import gzip
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from slipstream.errors import InputError
from slipstream.osm.extract import open_extract, write_roads
from slipstream.osm.importing import left_out
from slipstream.osm.netconvert import find_netconvert, warnings_of
from slipstream.osm.survey import Survey, survey_of
from slipstream.roads.sumo_net import load_network
from slipstream_cli.main import main

SIGNAL = '<tag k="highway" v="traffic_signals"/>'


def _extract() -> str:
    """A grid of 3 by 3 junctions with a signal in the middle, and what no car drives on."""
    nodes = {
        10 * i + j: (42.73 + 0.003 * i, -73.69 + 0.004 * j) for i in range(3) for j in range(3)
    }
    nodes |= {100 + k: (42.8, -73.6 + 0.001 * k) for k in range(3)}
    rows = ([0, 1, 2], [10, 11], [11, 12], [20, 21, 22])
    columns = ([0, 10, 20], [1, 11], [11, 21], [2, 12, 22])
    ways: list[tuple[list[int], dict[str, str]]] = [
        *((row, {"highway": "secondary"}) for row in rows),
        *((column, {"highway": "residential"}) for column in columns),
        ([0, 11, 22], {"highway": "footway"}),
        ([100, 101], {"highway": "residential"}),
        ([0, 12], {"highway": "service"}),
        ([2, 11], {"highway": "residential", "motor_vehicle": "no"}),
        ([1, 10], {"highway": "raceway"}),
        ([101, 102], {"railway": "rail"}),
        ([0, 1, 11, 0], {"building": "yes"}),
    ]
    text = "".join(
        f'<node id="{number + 1}" lat="{lat:.4f}" lon="{lon:.4f}" version="1">'
        f"{SIGNAL if number == 11 else ''}</node>"
        for number, (lat, lon) in nodes.items()
    )
    for number, (refs, tags) in enumerate(ways, start=1):
        inner = "".join(f'<nd ref="{ref + 1}"/>' for ref in refs)
        inner += "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items())
        text += f'<way id="{number}" version="1">{inner}</way>'
    for number, last in ((1, 3), (2, 99)):  # the second one names a way that is not there
        members = (("from", "way", 6), ("via", "node", 12), ("to", "way", last))
        inner = "".join(f'<member type="{t}" ref="{n}" role="{r}"/>' for r, t, n in members)
        tags = '<tag k="type" v="restriction"/><tag k="restriction" v="no_left_turn"/>'
        text += f'<relation id="{number}" version="1">{inner}{tags}</relation>'
    return f'<osm version="0.6">{text}</osm>'


def read(path: Path, folder: Path) -> tuple[Survey, Path]:
    """What an extract has, and its open roads as XML."""
    extract, roads = open_extract(path, folder), folder / "roads.osm.xml"
    survey = survey_of(extract)
    write_roads(extract, roads, survey.is_wanted, survey.road_nodes, {})
    return survey, roads


@pytest.mark.parametrize(
    "name",
    ["t.osm", "t.osm.xml.gz", "t.osm.bz2", "t.osm.pbf", "T.OSM", "T.OSM.XML.GZ", "T.OSM.BZ2"],
)
def test_an_extract_is_read_in_every_form(tmp_path: Path, name: str) -> None:
    """Plain, packed and binary: the same ways, nodes and restrictions."""
    plain, path = tmp_path / "t.osm", tmp_path / name
    plain.write_text(_extract())
    if name.lower().endswith("pbf"):
        osmium = pytest.importorskip("osmium")
        with osmium.SimpleWriter(osmium.io.File(str(path), "pbf")) as writer:
            for thing in osmium.FileProcessor(plain):
                writer.add(thing)
    elif name == "T.OSM":
        path.write_bytes(b"\xef\xbb\xbf" + _extract().encode())  # with a byte order mark
    elif name != "t.osm":
        pack = gzip.compress if name.lower().endswith("gz") else bz2.compress
        path.write_bytes(pack(_extract().encode()))
    folder = tmp_path / "work"
    folder.mkdir()
    survey, roads = read(path, folder)
    assert sorted(survey.roads) == list(range(1, 14))
    assert (survey.railways, survey.others, survey.restrictions) == (1, 1, 2)
    assert survey.roads[9].nodes == (1, 12, 23)
    again, _ = read(roads.rename(tmp_path / "roads.osm"), folder)
    assert again.roads == {n: way for n, way in survey.roads.items() if n != 12}  # 12 is closed
    assert (again.railways, again.others, again.restrictions) == (0, 0, 2)


def test_each_way_that_a_net_has_not_has_its_reason(tmp_path: Path) -> None:
    """Ways for walking, closed ones, others' classes, those apart, and those lost in a junction."""
    path = tmp_path / "t.osm"
    path.write_text(_extract())
    survey, _ = read(path, tmp_path)
    assert left_out(survey, frozenset({1, 2, 3, 4, 5, 6, 7})) == {
        "footways, cycleways, paths, tracks": 1,
        "service roads (drives, alleys, car parks)": 1,
        "closed to cars (access, vehicle, motor_vehicle, motorcar)": 1,
        "no road for cars (raceway)": 1,
        "not connected to the others": 1,
        "inside a junction that was joined, or ending where nothing goes on": 1,
        "railways": 1,
        "no road class (buildings, water, borders)": 1,
    }


def test_what_netconvert_warns_of_explains_that_nothing_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], tool: Callable[[str], str]
) -> None:
    """A road whose nodes were not extracted."""
    if find_netconvert() is None:
        tool("netconvert")
    path = tmp_path / "t.osm"
    nodes = '<node id="1" lat="48.0" lon="16.0" version="1"/>'
    way = '<way id="7" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="primary"/></way>'
    path.write_text(f'<osm version="0.6">{nodes}{way}</osm>')
    assert main(["import", "osm", str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "(ref='2') is not known" in said
    assert said.count("\n") == 1


def test_warnings_of_netconvert_are_counted_by_kind() -> None:
    """The first of each is quoted; those about netconvert itself are left out."""
    said = (
        "Warning: Environment variable SUMO_HOME is not set, using built in type maps.\n"
        "pj_obj_create: Cannot find proj.db\n"
        "Warning: Speed of straight connection '12#3_0->-14_0' reduced by 3.50 due to turning.\n"
        "Warning: Removed a road without junctions: -226336485.\n"
        "Warning: Speed of straight connection 'a_0->b_1' reduced by 1 due to turning.\n"
        "Success.\n"
    )
    assert warnings_of(said) == {
        "Speed of straight connection '12#3_0->-14_0' reduced by 3.50 due to turning.": 2,
        "Removed a road without junctions: -226336485.": 1,
    }


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("t.txt", b"x", "not known as an OpenStreetMap extract; give .osm"),
        ("t.osm", b"<gpx/>", "a <gpx>, no OpenStreetMap extract"),
        ("t.osm", b"<osm><way", "not OpenStreetMap's XML"),
        ("t.osm.gz", gzip.compress(b"<osm/>", mtime=0)[:-9], "damaged"),
        ("t.osm.bz2", bz2.compress(b"<osm/>" * 99)[:-9], "damaged"),
        ("t.osm.bz2", b"no bzip2", "damaged"),
        ("t.osm.pbf", b"no protocol buffer", "damaged"),
        ("t.osm", b"<osm><way id='x'/></osm>", "not OpenStreetMap's XML"),
        (
            "t.osm",
            b"<osm><way id='1'><tag k='building' v='yes'/></way></osm>",
            "no way with a road",
        ),
    ],
)
def test_an_extract_that_is_none_is_one_line(
    tmp_path: Path, name: str, content: bytes, told: str
) -> None:
    """Other files, damaged and empty ones are refused before netconvert is asked."""
    if name.endswith("pbf"):
        pytest.importorskip("osmium")
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read(path, tmp_path)
    assert str(caught.value).startswith(str(path))
    assert told in str(caught.value)


def test_the_command_says_where_netconvert_is_to_be_had(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line, exit status 2."""
    monkeypatch.setattr("slipstream.osm.netconvert.find_netconvert", lambda: None)
    path = tmp_path / "t.osm"
    path.write_text(_extract())
    assert main(["import", "osm", str(path), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.startswith(
        "slipstream: netconvert: not installed; pip install eclipse-sumo"
    )


@pytest.mark.slow
def test_an_imported_town_is_one_that_the_commands_take(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], tool: Callable[[str], str]
) -> None:
    """Its net has the roads, the signal and the projection; its fleet file is served; what was left
    out is counted; a second import leaves the fleet file as the user has it.
    """
    if find_netconvert() is None:
        tool("netconvert")
    path, out = tmp_path / "t.osm", tmp_path / "out dir"
    path.write_text(_extract())
    assert main(["import", "osm", str(path), "--out", str(out), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["ways"], summary["signals"]) == (8, 1)
    assert not any("restriction" in text for text in summary["netconvert_warnings"])
    assert (summary["turn_restrictions"], summary["turn_restrictions_ignored"]) == (2, 1)
    assert summary["ways_left_out"]["not connected to the others"] == 1
    network = load_network(summary["net"])
    assert network.projection is not None
    assert network.projection.place_m(42.733, -73.686) == pytest.approx(
        next(network.junctions[name] for name in network.signals), abs=1.0
    )
    fleet = Path(summary["fleet"])
    assert main(["check", str(fleet), "--network", summary["net"]]) == 0
    assert capsys.readouterr().out == f"{fleet}: valid fleet\n"
    fleet.write_text("mine")
    assert main(["import", "osm", str(path), "--out", str(out)]) == 0
    assert fleet.read_text() == "mine"
    said = capsys.readouterr().out
    assert "turn restrictions ignored: 1 of 2" in said
    assert "driven on the right: it lies in no country that drives on the left" in said
    assert "km taken as 50 km/h: residential streets" in said
    assert f"slipstream world --scenario t --net '{out / 't.net.xml.gz'}'" in said

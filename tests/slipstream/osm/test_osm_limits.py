"""Limits that a map does not sign are the law's, inside and outside of built-up areas."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from slipstream.osm.extract import open_extract
from slipstream.osm.importing import import_osm
from slipstream.osm.limits import Limit, limits, signed_kmh
from slipstream.osm.netconvert import find_netconvert
from slipstream.osm.survey import survey_of
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network
from slipstream.vehicle_types import PRESETS
from slipstream_cli.main import main
from tests.slipstream.osm.osm_maps import Tags, town, write

FIELDS = {1: (48.0, 16.0), 2: (48.0, 16.02), 3: (48.0, 16.04)}


def taken(path: Path, country: str | None = None) -> dict[int, Limit]:
    """Limits of an extract's ways that have none signed."""
    return limits(survey_of(open_extract(path, path.parent)), country)


def road(folder: Path, tags: Tags, **more: Tags) -> Path:
    """A road of 3 km with some tags over open country, with a residential street far away, or
    inside of an area with some tags.
    """
    nodes = {**FIELDS, 8: (48.1, 16.0), 9: (48.1, 16.01)}
    ways: dict[int, Any] = {1: ((1, 2, 3), tags), 2: ((8, 9), {"highway": "residential"})}
    if more:
        corners = ((47.99, 15.99), (47.99, 16.05), (48.01, 16.05), (48.01, 15.99))
        nodes.update(dict(zip((11, 12, 13, 14), corners, strict=True)))
        ways[3] = ((11, 12, 13, 14, 11), more["area"])
    return write(folder / "road.osm", nodes, ways)


@pytest.mark.parametrize(
    "road_class", ["trunk", "primary", "secondary", "tertiary", "unclassified"]
)
def test_a_street_in_a_town_is_not_driven_at_100(tmp_path: Path, road_class: str) -> None:
    """Side streets beside it, or an area around it, tell that it is in a town."""
    tags = {f"m{k}": {"highway": road_class} for k in (1, 2, 3)}
    found = taken(town(tmp_path / "t.osm", tags=tags))
    assert {limit.kmh for limit in found.values()} == {50.0}
    assert {found[100].why, found[200].why} == {"inside of built-up areas", "residential streets"}
    for area in ({"landuse": "residential"}, {"landuse": "retail"}, {"place": "village"}):
        inside = taken(road(tmp_path, {"highway": road_class}, area=area))
        assert inside[1] == Limit(50.0, "inside of built-up areas")
    forest = taken(road(tmp_path, {"highway": road_class}, area={"landuse": "forest"}))
    assert forest[1].why == "outside of built-up areas"


def test_the_outer_lines_of_a_relation_bound_an_area_too(tmp_path: Path) -> None:
    """In as many ways as it has, and without its holes."""
    corners = ((47.99, 15.99), (47.99, 16.05), (48.01, 16.05), (48.01, 15.99))
    nodes = {**FIELDS, **dict(zip((11, 12, 13, 14), corners, strict=True))}
    ways: dict[int, Any] = {
        1: ((1, 2, 3), {"highway": "primary"}),
        2: ((11, 12, 13), {}),
        3: ((13, 14, 11), {}),
    }
    tags = {"type": "multipolygon", "landuse": "residential"}
    members = [("way", 2, "outer"), ("way", 3, "outer")]
    path = write(tmp_path / "a.osm", nodes, ways, [(members, tags)])
    assert taken(path)[1] == Limit(50.0, "inside of built-up areas")
    hole = ((47.999, 15.995), (47.999, 16.045), (48.001, 16.045), (48.001, 15.995))
    nodes.update(dict(zip((21, 22, 23, 24), hole, strict=True)))
    ways[4] = ((21, 22, 23, 24, 21), {})
    path = write(tmp_path / "b.osm", nodes, ways, [([*members, ("way", 4, "inner")], tags)])
    assert taken(path)[1].why == "outside of built-up areas"


@pytest.mark.parametrize(
    ("tags", "country", "kmh"),
    [
        ({}, None, 80),
        ({}, "DE", 100),
        ({}, "FR", 80),
        ({}, "GB", 96.6),
        ({"highway": "motorway"}, "AT", 130),
        ({"highway": "primary_link"}, "DE", 80),
        ({"maxspeed": "FR:urban"}, None, 50),
        ({"maxspeed": "RO:rural"}, None, 90),
        ({"maxspeed:type": "DE:urban"}, None, 50),
        ({"source:maxspeed": "AT:zone30"}, None, 30),
        ({"source:maxspeed": "DE:zone:30"}, None, 30),
        ({"zone:traffic": "BE:urban"}, None, 50),
        ({"zone:maxspeed": "30"}, None, 30),
        ({"zone:maxspeed": "DE:30"}, None, 30),
        ({"maxspeed:type": "GB:nsl_single"}, None, 96.6),
        ({"source:maxspeed": "sign"}, "DE", 100),
        ({"maxspeed": "signals"}, "DE", 100),
        ({"sidewalk": "both"}, "DE", 50),
    ],
)
def test_a_limit_is_the_countrys_and_what_tags_say_of_it(
    tmp_path: Path, tags: Tags, country: str | None, kmh: float
) -> None:
    """On a road outside of built-up areas."""
    found = taken(road(tmp_path, {"highway": "primary", **tags}), country)
    assert found[1].kmh == pytest.approx(kmh, abs=0.1)


def test_where_nothing_tells_town_from_country_streets_count_as_built_up(tmp_path: Path) -> None:
    """And it says so."""
    path = write(tmp_path / "t.osm", FIELDS, {1: ((1, 2, 3), {"highway": "primary"})})
    assert taken(path)[1].kmh == 50.0
    assert "nothing that tells town from country" in taken(path)[1].why


@pytest.mark.parametrize(
    ("text", "kmh"),
    [("50", 50), ("30 mph", 48.28), ("50 km/h", 50), ("30;50", 30), ("none", "none"), ("x", None)],
)
def test_a_signed_limit_holds(tmp_path: Path, text: str, kmh: object) -> None:
    """With its unit; of several the lowest."""
    found = signed_kmh({"maxspeed": text})
    assert found == (pytest.approx(kmh, abs=0.01) if isinstance(kmh, int | float) else kmh)
    path = road(tmp_path, {"highway": "primary", "maxspeed": text})
    assert (1 in taken(path)) == (kmh is None)


@pytest.fixture
def netconvert(tool: Callable[[str], str]) -> None:
    """Skip the test without it."""
    if find_netconvert() is None:
        tool("netconvert")


def imported(path: Path, **options: Any) -> RoadNetwork:
    """The net of an extract."""
    return load_network(import_osm(path, path.with_suffix(".net.xml.gz"), **options).net)


@pytest.mark.slow
@pytest.mark.usefixtures("netconvert")
def test_the_import_says_which_limits_it_took_and_the_net_has_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In km, by limit and reason; `init` says it too. Signed limits are taken as they are."""
    path = town(tmp_path / "t.osm", tags={"m1": {"maxspeed": "40"}}, more={"addr:country": "AT"})
    out = tmp_path / "out"
    assert main(["import", "osm", str(path), "--out", str(out), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["country"] == "AT"
    assert (summary["driving_side"], summary["driving_side_by"]) == (
        "right",
        "the map's country is AT",
    )
    rows = {row["why"]: row for row in summary["limits_not_signed"]}
    assert rows["inside of built-up areas"] == {
        "kmh": 50, "why": "inside of built-up areas", "km": pytest.approx(0.8, abs=0.05),
    }  # fmt: skip
    assert rows["residential streets"]["km"] == pytest.approx(1.8, abs=0.05)
    network = load_network(summary["net"])
    limits_kmh = {s.name: round(s.speed_limit_mps * 3.6) for s in network.segments.values()}
    assert limits_kmh == {"m1": 40, "m2": 50, "m3": 50, "s1": 50, "s2": 50, "s3": 50}
    assert main(["init", str(tmp_path / "place"), "--osm", str(path), "--country", "DE"]) == 0
    said = capsys.readouterr().err
    assert "driven on the right: the country is DE" in said
    assert "km taken as 50 km/h: residential streets" in said


@pytest.mark.usefixtures("netconvert")
def test_ways_that_are_joined_keep_the_strictest_limit_and_only_their_own_tunnel(
    tmp_path: Path,
) -> None:
    """netconvert makes one edge of two ways; a lorry keeps off where either is too weak for it, and
    a street that passes a tunnel is none.
    """
    nodes = {n: (48.0, 16.0 + 0.002 * n) for n in range(1, 6)} | {6: (48.003, 16.01)}
    same = {"highway": "primary", "name": "Bridge Street", "maxspeed": "50"}
    path = write(
        tmp_path / "t.osm",
        nodes,
        {
            1: ((1, 2), {**same, "maxweight": "14"}),
            2: ((2, 3), {**same, "maxweight": "25", "tunnel": "yes"}),
            3: ((3, 4, 5), {**same, "maxaxleload": "6 t", "tunnel": "yes"}),
            4: ((3, 6, 1), {"highway": "residential"}),
            5: ((5, 6), {"highway": "residential", "maxweight": "as signed"}),
        },
    )
    network = imported(path)
    ways = {s.id.lstrip("-").partition("#")[0]: s for s in network.segments.values()}
    truck, van = PRESETS["truck_40t"].profile, PRESETS["van"].profile
    joined = ways["1"]
    assert joined.end == "3" or joined.start == "3"
    assert joined.access.max_mass_kg == 14_000
    assert not joined.access.admits(truck)
    assert (joined.in_tunnel, joined.allows_stops) == (False, True)
    assert (ways["3"].in_tunnel, ways["3"].allows_stops) == (True, False)
    assert ways["3"].access.admits(van)
    assert not ways["3"].access.admits(truck)
    assert not ways["5"].access.admits(van), "its limit cannot be read"


@pytest.mark.slow
@pytest.mark.usefixtures("netconvert")
@pytest.mark.parametrize("at", [(-16.846, 179.9965), (-33.9, 151.2), (65.98, 179.9965)])
def test_places_come_out_right_over_the_date_line_and_in_the_south(
    tmp_path: Path, at: tuple[float, float], capsys: pytest.CaptureFixture[str]
) -> None:
    """Junctions keep their latitude and longitude, lengths are true, and `net find` and `init` find
    them.
    """
    path = town(tmp_path / "t.osm", at)
    network = imported(path, side="left")
    assert network.projection is not None
    middle = network.junctions[next(iter(network.signals))]
    ((lat, lon),) = network.projection.degrees([middle])
    want = at[0] + 0.0027, (at[1] + 0.0027 + 180) % 360 - 180
    assert (lat, lon) == pytest.approx(want, abs=1e-5)
    sides = [s.length_m for s in network.segments.values() if s.name.startswith("s")]
    assert all(270 < length < 305 for length in sides)
    net = str(path.with_suffix(".net.xml.gz"))
    place = f"{lat:.6f},{lon:.6f}"
    assert main(["net", "find", "--net", net, "--json", "--", place]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["distance_m"] < 20
    assert answer["stop"]["distance_m"] < 20
    folder = str(tmp_path / "place")
    assert main(["init", folder, "--net", net, f"--at={place}", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["distance_m"] < 20
    assert main(["net", "show", "--net", net, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["width_m"] < 700

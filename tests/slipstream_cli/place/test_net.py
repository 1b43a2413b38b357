"""Segments and junctions are found by street name and by place."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from slipstream.roads import RoadNetwork
from slipstream.roads.projection import Projection
from slipstream_cli.main import main
from slipstream_cli.place.net import compass
from slipstream_cli.place.streets import place_of

TROY = str(resources.files("slipstream_lab.simulation.scenarios") / "data/troy/troy.net.xml.gz")


def found(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    """What `net find --json` prints."""
    assert main(["net", "find", *words, "--json"]) == 0
    answer: dict[str, Any] = json.loads(capsys.readouterr().out)
    return answer


@pytest.mark.slow
@pytest.mark.parametrize("query", ["Hoosick St", "hoosick street", "HOOSICK ST.", "hosick st"])
def test_a_street_is_found_by_a_name_that_is_not_exact(
    query: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Case, points, short words and a slip of the pen."""
    answer = found(capsys, query, "--net", TROY, "--limit", "100")
    assert answer["streets"][0].startswith("Hoosick St")
    first = answer["segments"][0]
    assert first.keys() == {
        *("id", "street", "road_class", "length_m", "speed_limit_kmh", "lanes", "direction"),
        *("start", "end"),
    }
    assert first["length_m"] > 0
    assert {j["id"] for j in answer["junctions"]} == {
        end for row in answer["segments"] for end in (row["start"], row["end"])
    }
    assert all(42 < j["lat"] < 43 and -74 < j["lon"] < -73 for j in answer["junctions"])


@pytest.mark.slow
def test_the_nearest_segments_of_a_place_come_first(capsys: pytest.CaptureFixture[str]) -> None:
    """At a junction's own coordinates the nearest road touches it."""
    answer = found(capsys, "Hoosick St", "--net", TROY, "--limit", "1")
    junction = answer["junctions"][0]
    place = f"{junction['lat']},{junction['lon']}"
    near = found(capsys, place, "--net", TROY, "--limit", "3")["segments"]
    distances = [row["distance_m"] for row in near]
    assert len(near) == 3
    assert distances == sorted(distances)
    assert junction["id"] in (near[0]["start"], near[0]["end"])
    assert distances[0] < 30


def test_a_net_without_a_projection_takes_metres(capsys: pytest.CaptureFixture[str]) -> None:
    """The demo's: x and y."""
    answer = found(capsys, "0,0", "--limit", "1")
    assert answer["segments"][0]["distance_m"] >= 0
    assert "lat" not in answer["junctions"][0]


@pytest.mark.slow
def test_segments_are_found_by_their_ids(capsys: pytest.CaptureFixture[str]) -> None:
    """A part of the id, in any case; the whole id alone, or before the streets with that name."""
    answer = found(capsys, "Avenue", "--limit", "100")
    ids = [row["id"] for row in answer["segments"]]
    assert answer["streets"] == []
    assert "avenue_east" in ids
    assert all("avenue" in name for name in ids)
    assert [row["id"] for row in found(capsys, ids[-1])["segments"]] == [ids[-1]]
    first = found(capsys, "Hoosick St", "--net", TROY)["segments"][0]["id"]
    assert found(capsys, first, "--net", TROY)["segments"][0]["id"] == first


@pytest.mark.slow
def test_junctions_are_found_by_their_ids(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Such as that of the depot that `init` prints, with the segments that meet there."""
    assert main(["init", str(tmp_path / "place"), "--net", TROY, "--json"]) == 0
    depot = json.loads(capsys.readouterr().out)["depot"]
    answer = found(capsys, depot, "--net", TROY)
    assert [j["id"] for j in answer["junctions"]] == [depot]
    assert answer["segments"]
    assert all(depot in (row["start"], row["end"]) for row in answer["segments"])


@pytest.mark.slow
@pytest.mark.parametrize(
    "query", ["Hoosick St & 15th St", "15th street / hoosick", "hoosick and 15th st"]
)
def test_a_junction_is_found_by_the_streets_that_meet_there(
    query: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """In either order, with the usual signs between them."""
    answer = found(capsys, query, "--net", TROY)
    assert len(answer["junctions"]) == 1
    names = " ".join(row["street"] for row in answer["segments"])
    assert ("Hoosick" in names, "15th" in names) == (True, True)


@pytest.mark.slow
def test_streets_that_meet_nowhere_say_so(capsys: pytest.CaptureFixture[str]) -> None:
    """In one line with both names."""
    assert main(["net", "find", "Hoosick St & Campbell Ave", "--net", TROY]) == 2
    assert "'Hoosick St' and 'Campbell Ave' meet at no junction" in capsys.readouterr().err


def test_a_place_far_from_the_net_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """One line with the distance on standard error, and in the JSON; none for a place nearby."""
    assert main(["net", "find", "0,774000", "--limit", "1", "--json"]) == 0
    said = capsys.readouterr()
    answer = json.loads(said.out)
    assert answer["far"] is True
    assert answer["distance_m"] == answer["segments"][0]["distance_m"] > 700_000
    km = answer["distance_m"] / 1000
    assert said.err == f"slipstream: 0,774000: {km:.1f} km from the nearest segment of demo\n"
    assert main(["net", "find", "900,904", "--limit", "1", "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["far"] is False
    assert said.err == ""


@pytest.mark.slow
def test_what_is_cut_off_is_counted(capsys: pytest.CaptureFixture[str]) -> None:
    """No silent limit."""
    assert main(["net", "find", "Hoosick St", "--net", TROY, "--limit", "1"]) == 0
    assert "more: --limit " in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("Champs-Élysées", "no street is called so; the nearest is"),
        ("99,200", "no latitude and longitude"),
    ],
)
def test_what_is_nowhere_is_one_line(
    query: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit status 2."""
    assert main(["net", "find", query, "--net", TROY]) == 2
    assert said in capsys.readouterr().err


def test_a_net_without_names_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    """It is not that the name is wrong."""
    assert main(["net", "find", "Main Street"]) == 2
    assert "the net has no street names" in capsys.readouterr().err


def test_the_summary_counts_what_the_net_has(capsys: pytest.CaptureFixture[str]) -> None:
    """Troy's."""
    assert main(["net", "show", "--net", TROY, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["segments"], summary["junctions"], summary["signals"]) == (470, 178, 66)
    south, west = summary["south_west"]
    assert (42 < south < 43, -74 < west < -73) == (True, True)


@pytest.mark.parametrize(
    ("dx", "dy", "word"),
    [
        (1, 0, "east"),
        (0, 1, "north"),
        (-1, 0, "west"),
        (-1, -1, "south-west"),
        (1, -1, "south-east"),
    ],
)
def test_directions_are_told_as_on_a_map(dx: float, dy: float, word: str) -> None:
    """x is east, y is north."""
    assert compass(dx, dy) == word


def test_longitudes_go_on_over_the_date_line() -> None:
    """180.002 east is 179.998 west; south is below 0."""
    network = SimpleNamespace(projection=Projection("+proj=utm +zone=1 +south", (0.0, 0.0)))
    east = place_of("-16.846,180.002", cast(RoadNetwork, network))
    west = place_of("-16.846,-179.998", cast(RoadNetwork, network))
    assert east is not None
    assert east == pytest.approx(west, abs=1e-3)

"""The side that is driven on is told, read off the map or its place, or asked for; and nets of the
left side are drawn and driven as such.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dashboard.scene.canvas import Canvas
from dashboard.view.places import Places
from dashboard.web.network import network_document
from dashboard.web.tables.rows import Scene
from slipstream.errors import InputError
from slipstream.osm.extract import open_extract
from slipstream.osm.netconvert import find_netconvert
from slipstream.osm.side import driving_side, side_at
from slipstream.osm.survey import Survey, survey_of
from slipstream.roads.sumo_net import load_network
from slipstream_cli.main import main
from tests.slipstream.osm.osm_maps import town, write

LEFT = {
    "London": (51.5, -0.12), "Dover": (51.13, 1.31), "Belfast": (54.6, -5.93),
    "Dublin": (53.35, -6.26), "Saint Helier": (49.19, -2.1), "Valletta": (35.9, 14.51),
    "Nicosia": (35.17, 33.36), "Tokyo": (35.68, 139.7), "Sapporo": (43.06, 141.35),
    "Fukuoka": (33.59, 130.4), "Naha": (26.21, 127.68), "Bangkok": (13.75, 100.5),
    "Chiang Mai": (18.79, 98.98), "Phuket": (7.88, 98.39), "Kuala Lumpur": (3.14, 101.69),
    "Singapore": (1.35, 103.82), "Jakarta": (-6.2, 106.82), "Brunei": (4.9, 114.94),
    "Dili": (-8.56, 125.57), "Port Moresby": (-9.44, 147.18), "Sydney": (-33.87, 151.21),
    "Perth": (-31.95, 115.86), "Hobart": (-42.88, 147.33), "Auckland": (-36.85, 174.76),
    "Suva": (-18.14, 178.44), "Taveuni": (-16.85, -179.99), "Apia": (-13.83, -171.77),
    "Nuku'alofa": (-21.14, -175.2), "Delhi": (28.61, 77.21), "Mumbai": (19.08, 72.88),
    "Chennai": (13.08, 80.27), "Colombo": (6.93, 79.86), "Karachi": (24.86, 67.01),
    "Lahore": (31.55, 74.34), "Islamabad": (33.69, 73.06), "Dhaka": (23.81, 90.41),
    "Kathmandu": (27.72, 85.32), "Thimphu": (27.47, 89.64), "Cape Town": (-33.92, 18.42),
    "Johannesburg": (-26.2, 28.05), "Windhoek": (-22.56, 17.08), "Harare": (-17.83, 31.05),
    "Maputo": (-25.97, 32.58), "Lusaka": (-15.39, 28.32), "Lilongwe": (-13.96, 33.79),
    "Dar es Salaam": (-6.79, 39.21), "Nairobi": (-1.29, 36.82), "Kampala": (0.35, 32.58),
    "Georgetown": (6.8, -58.16), "Paramaribo": (5.85, -55.2), "Kingston": (17.97, -76.79),
    "Nassau": (25.05, -77.36), "Port of Spain": (10.66, -61.51), "Bridgetown": (13.1, -59.61),
    "Hamilton": (32.29, -64.78), "Stanley": (-51.69, -57.86), "Victoria": (-4.62, 55.45),
    "Port Louis": (-20.16, 57.5), "Charlotte Amalie": (18.34, -64.93),
}  # fmt: skip
RIGHT = {
    "Vienna": (48.2, 16.37), "Berlin": (52.52, 13.4), "Paris": (48.86, 2.35),
    "Calais": (50.95, 1.86), "Boulogne": (50.73, 1.61), "Cherbourg": (49.64, -1.62),
    "Dieppe": (49.92, 1.08), "Dunkirk": (51.03, 2.38), "Oslo": (59.91, 10.75),
    "Reykjavik": (64.15, -21.94), "Seoul": (37.57, 126.98), "Busan": (35.18, 129.08),
    "Vladivostok": (43.12, 131.89), "Yuzhno-Sakhalinsk": (46.96, 142.73), "Taipei": (25.03, 121.57),
    "Shanghai": (31.23, 121.47), "Manila": (14.6, 120.98), "Zamboanga": (6.91, 122.07),
    "Hanoi": (21.03, 105.85), "Ho Chi Minh City": (10.8, 106.7), "Noumea": (-22.28, 166.46),
    "Port Vila": (-17.73, 168.32), "Pago Pago": (-14.28, -170.7), "Papeete": (-17.53, -149.57),
    "Honolulu": (21.31, -157.86), "Luanda": (-8.84, 13.23), "Antananarivo": (-18.88, 47.51),
    "Addis Ababa": (9.03, 38.74), "Dubai": (25.2, 55.27), "Saint-Denis": (-20.88, 55.45),
    "Caracas": (10.48, -66.9), "Cayenne": (4.92, -52.33), "Manaus": (-3.12, -60.02),
    "Miami": (25.76, -80.19), "Havana": (23.11, -82.37), "San Juan": (18.47, -66.11),
    "Fort-de-France": (14.6, -61.07), "Pointe-a-Pitre": (16.24, -61.53), "Troy": (42.73, -73.68),
    "Athens": (37.98, 23.73), "Tripoli": (32.89, 13.19), "Palermo": (38.12, 13.36),
    "Antalya": (36.9, 30.7), "Beirut": (33.89, 35.5),
}  # fmt: skip


@pytest.mark.parametrize(("side", "cities"), [("left", LEFT), ("right", RIGHT)])
def test_the_side_is_known_where_a_city_lies(
    side: str, cities: dict[str, tuple[float, float]]
) -> None:
    """No city far from a border is taken for one of the other side, or asked about."""
    found = {name: side_at([place]) for name, place in cities.items()}
    assert {name for name, known in found.items() if known is None or known.side != side} == set()


@pytest.mark.parametrize(
    "place", [(17.97, 102.63), (-1.95, 30.06), (27.53, 88.95), (22.2, 113.55), (7.5, -60.5)]
)
def test_near_a_border_between_left_and_right_the_side_is_asked_for(
    tmp_path: Path, place: tuple[float, float], capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line that names the options; a country or a side that is told is enough."""
    path = town(tmp_path / "t.osm", place)
    assert main(["import", "osm", str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "--driving-side left or right, or --country" in said
    assert said.count("\n") == 1
    survey = _survey(path)
    assert driving_side(survey, "right", None, path).side == "right"
    assert driving_side(survey, None, "TH", path).side == "left"


def _survey(path: Path) -> Survey:
    return survey_of(open_extract(path, path.parent))


def test_what_the_map_says_of_its_side_counts_before_where_it_lies(tmp_path: Path) -> None:
    """The tag `driving_side`, or a country that it names; with how it is known."""
    place = (17.97, 102.63)
    path = town(tmp_path / "side.osm", place, more={"driving_side": "right"})
    assert str(driving_side(_survey(path), None, None, path)) == "right (by the map's driving_side)"
    path = town(tmp_path / "country.osm", place, more={"addr:country": "TH"})
    assert str(driving_side(_survey(path), None, None, path)) == "left (the map's country is TH)"
    path = town(tmp_path / "vienna.osm", more={"addr:country": "GB"})
    with pytest.raises(InputError, match=r"the map's country is GB\), but right"):
        driving_side(_survey(path), None, None, path)
    # One way with a side of its own says nothing of the others.
    path = town(tmp_path / "one.osm", tags={"m1": {"driving_side": "left"}})
    assert driving_side(_survey(path), None, None, path).side == "right"


@pytest.mark.parametrize(("order", "side"), [((1, 2, 3, 4, 1), "right"), ((4, 3, 2, 1), "left")])
def test_roundabouts_tell_the_side(tmp_path: Path, order: tuple[int, ...], side: str) -> None:
    """Anticlockwise ones, or arcs of them, are of the right side; where place and roundabouts
    contradict each other, nothing is taken.
    """

    def extract(place: tuple[float, float]) -> Path:
        corners = ((0, 0), (0, 1), (1, 1), (1, 0))
        nodes = {
            n: (place[0] + 2e-4 * a, place[1] + 2e-4 * b)
            for n, (a, b) in enumerate(corners, start=1)
        }
        tags = {"highway": "tertiary", "junction": "roundabout"}
        return write(tmp_path / f"{place[0]}.osm", nodes, {1: (order, tags)})

    near_a_border = extract((17.97, 102.63))
    found = driving_side(_survey(near_a_border), None, None, near_a_border)
    assert (found.side, found.why) == (side, "as 1 of 1 roundabouts turn")
    elsewhere = extract(RIGHT["Vienna"] if side == "left" else LEFT["London"])
    with pytest.raises(InputError, match=rf"but {side} \(as 1 of 1 roundabouts turn\)"):
        driving_side(_survey(elsewhere), None, None, elsewhere)


@pytest.fixture(scope="module")
def london(
    made_once: Callable[[str, Callable[[Path], object]], Path], tool: Callable[[str], str]
) -> Path:
    """The net of a town in England; skipped without netconvert."""
    if find_netconvert() is None:
        tool("netconvert")

    def build(folder: Path) -> None:
        tags = {"m2": {"lanes": "4"}}
        path = town(folder / "london.osm", LEFT["London"], tags)
        assert main(["import", "osm", str(path), "--out", str(folder)]) == 0

    return made_once("london", build) / "london.net.xml.gz"


@pytest.mark.slow
def test_a_left_hand_map_becomes_a_left_hand_net(london: Path) -> None:
    """Its roads lie on the left of their streets' middle; the page and the 3D view draw them
    there."""
    network = load_network(london)
    assert network.left_hand
    assert not load_network("demo").left_hand
    for segment in network.segments.values():
        (x0, y0), (x1, y1) = segment.shape[0], segment.shape[-1]
        start, end = network.junctions[segment.start], network.junctions[segment.end]
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        here = ((x0 + x1) / 2 - middle[0], (y0 + y1) / 2 - middle[1])
        assert (x1 - x0) * here[1] - (y1 - y0) * here[0] > 0, segment.id
        line = Canvas(network).offset_line(segment.id, 1.0)
        moved = line[0] - np.array([x0, y0])
        assert (x1 - x0) * moved[1] - (y1 - y0) * moved[0] > 0
    assert network_document(Scene(Places(network), {}))["left_hand"] is True


@pytest.mark.long
@pytest.mark.process
@pytest.mark.slow
def test_cameras_of_a_left_hand_net_see_its_lanes_where_they_are(
    london: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The outline that is calibrated has the lanes that SUMO has, and the mast is at the kerb."""
    network = load_network(london)
    wide = next(s for s in network.segments.values() if s.lanes == 2 and s.length_m > 150)
    rsus = tmp_path / "rsus.toml"
    rsus.write_text(
        f'[[rsus]]\nid = "r"\nwatch = [{{ segment = "{wide.id}", from_m = 90.0, '
        f"to_m = {wide.length_m - 5:.0f}.0, from_lane = 1 }}]\n"
    )
    routes = tmp_path / "r.rou.xml"
    routes.write_text(
        f'<routes><vehicle id="v" depart="0"><route edges="{wide.id}"/></vehicle></routes>'
    )
    clip = ("clip", "sumo", "--net", str(london), "--routes", str(routes), "--rsu", str(rsus))
    short = ("--out", str(tmp_path), "--seconds", "0.2", "--fps", "10", "--begin", "5")
    assert main([*clip, *short]) == 0, capsys.readouterr().err
    camera = (tmp_path / "camera.toml").read_text()
    polygon = json.loads(camera.partition("polygon = ")[2].partition("\n")[0])
    (x0, y0), (x1, y1) = wide.shape[0], wide.shape[-1]
    ahead = np.array([x1 - x0, y1 - y0]) / math.dist((x0, y0), (x1, y1))
    right = (np.array(polygon) - np.array([x0, y0])) @ np.array([ahead[1], -ahead[0]])
    # Of two lanes the one away from the kerb: the right half.
    assert right.min() == pytest.approx(0.0, abs=0.2)
    assert right.max() == pytest.approx(3.2, abs=0.3)

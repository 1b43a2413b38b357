"""Addresses are served where a vehicle may stop, and how far off that is, is told."""

from __future__ import annotations

import gzip
import math
from dataclasses import replace
from importlib import resources
from pathlib import Path

import pytest

from slipstream.roads import RoadNetwork, Segment, build_network
from slipstream.roads.projection import Projection
from slipstream.roads.snapping import NoPlaceError, Snapper, lacks_classes, stopping_junctions
from slipstream.roads.sumo_net import load_network
from slipstream.vehicle_types import RoutingProfile

CAR = RoutingProfile()
PLAIN = Projection("+proj=utm +zone=33 +ellps=WGS84 +datum=WGS84 +units=m +no_defs", (0.0, 0.0))
EAST_M, NORTH_M = 500_000.0, 5_300_000.0


def roads(**fast: object) -> RoadNetwork:
    """A street of 1.4 km, 100 m north of a road of its length that is as given; at its east end a
    ramp between them.
    """
    places = {"sw": (0.0, 0.0), "se": (1400.0, 0.0), "nw": (0.0, 100.0), "ne": (1400.0, 100.0)}
    at = {name: (EAST_M + x, NORTH_M + y) for name, (x, y) in places.items()}

    def road(name: str, start: str, end: str, **kind: object) -> Segment:
        plain = Segment(
            name, start, end, math.dist(at[start], at[end]), 13.9, 1, (at[start], at[end])
        )
        return replace(plain, **{"road_class": "residential", **kind})  # type: ignore[arg-type]

    return build_network(
        "roads",
        [
            road("fast", "sw", "se", **fast),
            road("street", "nw", "ne"),
            road("ramp", "se", "ne", road_class="primary_link"),
        ],
        at,
        projection=PLAIN,
    )


def near(network: RoadNetwork, x_m: float, y_m: float) -> tuple[float, float]:
    """Latitude and longitude of a place in the network of `roads`."""
    assert network.projection is not None
    return network.projection.degrees([(EAST_M + x_m, NORTH_M + y_m)])[0]


@pytest.mark.parametrize(
    "fast",
    [
        {"road_class": "motorway"},
        {"road_class": "trunk", "speed_limit_mps": 13.9},
        {"road_class": "motorway_link"},
        {"road_class": "trunk_link"},
        {"road_class": "secondary_link"},
        {"in_tunnel": True},
        {"road_class": "", "speed_limit_mps": 27.8},
    ],
)
def test_no_address_is_served_on_an_expressway_a_ramp_or_in_a_tunnel(
    fast: dict[str, object],
) -> None:
    """The street that lies further away serves it; by its class, and by its limit where the net has
    none.
    """
    network = roads(**fast)
    found = Snapper(network, [CAR]).stop_for(*near(network, 300.0, 10.0))
    assert (found.segment, found.node) == ("street", "nw")
    assert lacks_classes(network) == (fast.get("road_class") == "")
    every = Snapper(network, [CAR], for_stops=False)
    assert [s.segment for s in every.near((EAST_M + 300.0, NORTH_M + 10.0), 2)] == [
        "fast",
        "street",
    ]


def test_the_distance_to_the_junction_is_told_beside_that_to_the_road() -> None:
    """A place 43 m beside the middle of a long road is served 690 m off, and says so."""
    network = roads(road_class="tertiary")
    found = Snapper(network, [CAR]).stop_for(*near(network, 688.0, -43.0))
    assert (found.segment, found.node) == ("fast", "sw")
    assert found.distance_m == pytest.approx(43.0, abs=0.1)
    assert found.to_node_m == pytest.approx(math.hypot(688.0, 43.0), abs=0.1)


def test_a_junction_beside_an_expressway_counts_as_further_away() -> None:
    """By 200 m: the quiet end of a street is taken where it is hardly further, but not for ever."""
    network = roads(road_class="motorway")
    snapper = Snapper(network, [CAR])
    places = {x: snapper.stop_for(*near(network, x, 110.0)) for x in (100.0, 750.0, 1300.0)}
    assert {x: found.node for x, found in places.items()} == {
        100.0: "nw",
        750.0: "nw",
        1300.0: "ne",
    }
    assert places[750.0].to_node_m == pytest.approx(750.0, abs=1.0)


def test_a_node_that_netconvert_adds_beside_a_ramp_is_no_place_to_stop() -> None:
    """The other end of the road serves the address, or another road."""
    network = roads(road_class="primary")
    renamed = {"se": "fast-AddedOnRampNode", "ne": "x-AddedOffRampNode"}
    segments = [
        replace(s, start=renamed.get(s.start, s.start), end=renamed.get(s.end, s.end))
        for s in network.segments.values()
    ]
    at = {renamed.get(name, name): place for name, place in network.junctions.items()}
    network = build_network("roads", segments, at, projection=PLAIN)
    assert Snapper(network, [CAR]).stop_for(*near(network, 1390.0, 5.0)).node == "sw"
    assert Snapper(network, [CAR]).stop_for(*near(network, 1390.0, 95.0)).node == "nw"
    assert set(stopping_junctions(network)) == {"nw", "sw"}


def test_a_place_beside_an_expressway_alone_is_refused_with_what_to_do() -> None:
    """Naming a junction is telling; so is a place elsewhere."""
    network = roads(road_class="motorway")
    with pytest.raises(NoPlaceError) as caught:
        Snapper(network, [CAR]).stop_for(*near(network, 500.0, -150.0))
    assert "no address is served ('fast' is a motorway)" in caught.value.problem
    assert caught.value.mend.startswith("name a junction as node")
    with pytest.raises(NoPlaceError, match="m from the nearest road that its vehicles may use"):
        Snapper(network, [CAR]).stop_for(*near(network, 500.0, -1500.0))


def test_class_tunnel_and_name_of_a_road_are_read_from_a_net(tmp_path: Path) -> None:
    """By the edge's type and parameter; a name that netconvert has escaped twice is a name, and a
    file's ending may be in capitals.
    """
    text = (resources.files("slipstream") / "data" / "demo.net.xml").read_text(encoding="utf-8")
    names = list(load_network("demo").segments)[:4]
    kinds = {
        names[0]: 'type="highway.trunk_link" name="O&amp;apos;Brien &amp;amp; Co"',
        names[1]: 'type="railway.tram|highway.primary"',
        names[2]: 'type="rural"',
    }
    for name, more in kinds.items():
        text = text.replace(f'<edge id="{name}" ', f'<edge id="{name}" {more} ')
    begin = text.index(f'<edge id="{names[3]}" ')
    end = text.index("</edge>", begin)
    text = text[:end] + '<param key="tunnel" value="yes"/>' + text[end:]
    path = tmp_path / "TOWN.NET.XML.GZ"
    path.write_bytes(gzip.compress(text.encode(), mtime=0))
    network = load_network(path)
    assert network.name == "TOWN"
    found = [network.segments[name] for name in names]
    assert [s.road_class for s in found] == ["trunk_link", "primary", "", ""]
    assert [s.in_tunnel for s in found] == [False, False, False, True]
    assert [s.allows_stops for s in found] == [False, True, True, False]
    assert found[0].name == "O'Brien & Co"

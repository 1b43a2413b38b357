"""Who may use a road: a net written by hand, with every restriction that a SUMO net can have."""

from __future__ import annotations

import logging
import math
from pathlib import Path

import pytest

from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.roads.access import OPEN, Access
from slipstream.roads.snapping import Snapper
from slipstream.roads.sumo_net import load_network
from slipstream.vehicle_types import PRESETS, RoutingProfile, VehicleType

CAR = RoutingProfile()
VAN = PRESETS["van"].profile
TRUCK = PRESETS["truck_40t"].profile

UTM_18 = "+proj=utm +zone=18 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"


def lane(edge: str, more: str = "", index: int = 0, speed: float = 13.89) -> str:
    """One lane of an edge."""
    return (
        f'<lane id="{edge}_{index}" index="{index}" speed="{speed}" length="100.00" '
        f'shape="0,0 100,0" {more}/>'
    )


def edge(name: str, start: str, end: str, inside: str = "", more: str = "") -> str:
    """An edge, of one open lane unless told otherwise."""
    ends = f'from="{start}" to="{end}"'
    return f'<edge id="{name}" {ends} priority="1" {more}>{inside or lane(name)}</edge>'


def junction(name: str, x: float, y: float = 0.0) -> str:
    """A junction without rules."""
    return (
        f'<junction id="{name}" type="priority" x="{x}" y="{y}" incLanes="" intLanes="" '
        f'shape="{x},{y}"/>'
    )


def connection(start: str, end: str, more: str = "", lanes: tuple[int, int] = (0, 0)) -> str:
    """A turn between two edges."""
    return (
        f'<connection from="{start}" to="{end}" fromLane="{lanes[0]}" toLane="{lanes[1]}" '
        f'dir="s" state="M" {more}/>'
    )


def net(path: Path, *parts: str, projection: str = "!") -> RoadNetwork:
    """A net of four junctions in a row, "a" to "d", 100 m apart, with these edges and turns."""
    location = (
        f'<location netOffset="-605160.10,-4727192.42" convBoundary="0,0,300,0" '
        f'origBoundary="0,0,1,1" projParameter="{projection}"/>'
    )
    junctions = "".join(junction(name, 100.0 * i) for i, name in enumerate("abcd"))
    path.write_text(f'<net version="1.20">{location}{"".join(parts)}{junctions}</net>')
    return load_network(path)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where a net goes."""
    return tmp_path / "town.net.xml"


def test_a_net_without_restrictions_is_open(path: Path) -> None:
    """To every class, in every direction."""
    open_net = net(path, edge("ab", "a", "b"), edge("bc", "b", "c"), connection("ab", "bc"))
    assert all(segment.access == OPEN for segment in open_net.segments.values())
    assert open_net.turn_classes == {}
    assert not open_net.is_restricted
    assert not load_network("demo").is_restricted


def test_a_footway_admits_no_vehicle_and_a_bus_lane_is_one_of_several(path: Path) -> None:
    """Any lane of its own will do."""
    road = net(
        path,
        edge("foot", "a", "b", lane("foot", 'allow="pedestrian"')),
        edge(
            "street",
            "b",
            "c",
            lane("street", 'allow="bus"') + lane("street", 'disallow="trailer"', 1),
        ),
        edge("rails", "c", "d", lane("rails", 'allow="tram"')),
    )
    assert [road.admits(name, VAN) for name in ("foot", "street", "rails")] == [False, True, False]
    assert not road.admits("street", TRUCK)
    bus = VehicleType(vehicle_class="bus").profile
    assert road.admits("street", bus)
    assert road.is_restricted


def test_a_turn_needs_lanes_and_a_connection_that_its_class_may_use(path: Path) -> None:
    """One connection from the bus's lane, one from the others', one for cars only."""
    two = lane("ab", 'allow="bus"') + lane("ab", 'disallow="bus"', 1)
    road = net(
        path,
        edge("ab", "a", "b", two),
        edge("bc", "b", "c"),
        edge("bd", "b", "d"),
        connection("ab", "bc", lanes=(0, 0)),
        connection("ab", "bd", 'allow="passenger"', lanes=(1, 0)),
    )
    bus = VehicleType(vehicle_class="bus").profile
    assert [road.admits_turn("ab", "bc", p) for p in (bus, CAR)] == [True, False]
    assert [road.admits_turn("ab", "bd", p) for p in (bus, CAR, VAN)] == [False, True, False]


@pytest.mark.parametrize(
    ("key", "value", "van", "truck"),
    [
        ("maxheight", "3.8", True, False),
        ("maxheight", "3.8 m", True, False),
        ("maxheight", "12'6\"", True, False),
        ("maxheight", "9'", False, False),
        ("maxheight", "default", True, True),
        ("maxwidth", "2.3", True, False),
        ("maxlength", "12", True, False),
        ("maxweight", "7.5", True, False),
        ("maxweight", "3,5 t", True, False),
        ("maxweight", "2800 kg", False, False),
        ("maxweight", "44", True, True),
        ("maxweightrating", "7.5", True, False),
        ("maxheight", "12' 6\"", True, False),
        ("maxheight", "13'6 9'", False, False),
        ("maxheight", "4.2 9 ft 0 in", False, False),
        ("maxweight", "14 25", True, False),
        ("maxweight", "25 14", True, False),
        ("maxweight", "44 3 t 60", False, False),
        ("maxweight", "3.5;44", True, False),
        ("maxweight", "44|3.5 t", True, False),
        ("maxweight", "7,5", True, False),
        ("maxweight", "26,000 lbs", True, False),
        ("maxweight", "5 st", True, False),
        ("maxweight", "none 44", True, True),
        ("maxweight", "unsigned", True, True),
        ("maxweight", "default none", True, True),
        ("maxaxleload", "8", True, False),
        ("maxaxleload", "11.5", True, True),
        ("maxaxleload", "2 t", False, False),
        ("maxwidth", "2.1 3", False, False),
        ("maxlength", "18 12", True, False),
    ],
)
def test_heights_and_weights_are_those_of_openstreetmap(
    path: Path, key: str, value: str, van: bool, truck: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Metres or feet, tonnes or pounds; of several values, as joined ways have, the smallest; an
    axle's load limits the mass of which it is never more than 0.7."""
    quoted = value.replace('"', "&quot;")
    inside = lane("ab") + f'<param key="{key}" value="{quoted}"/>'
    with caplog.at_level(logging.WARNING):
        road = net(path, edge("ab", "a", "b", inside))
    assert (road.admits("ab", VAN), road.admits("ab", TRUCK)) == (van, truck)
    assert road.admits("ab", CAR), "nothing is known of the paper's car"
    assert "cannot be read" not in caplog.text


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("maxheight", "low bridge"),
        ("maxheight", "4.2m3"),
        ("maxweight", "14 lorries"),
        ("maxweight", "25 see sign"),
        ("maxaxleload", "heavy"),
        ("maxwidth", "narrow"),
        ("maxlength", "-"),
    ],
)
def test_a_limit_that_cannot_be_read_keeps_out_who_might_be_above_it(
    path: Path, key: str, value: str, caplog: pytest.LogCaptureFixture
) -> None:
    """It counts as the strictest of its kind; one line says how many there are, and the first."""
    inside = f'<param key="{key}" value="{value}"/>'
    with caplog.at_level(logging.WARNING):
        road = net(
            path,
            edge("ab", "a", "b", lane("ab") + inside),
            edge("bc", "b", "c", lane("bc") + inside),
        )
    assert (road.admits("ab", VAN), road.admits("ab", TRUCK)) == (False, False)
    assert road.admits("ab", CAR), "nothing is known of the paper's car"
    assert len(caplog.records) == 1
    assert "2 limits cannot be read and count as the strictest" in caplog.text
    assert f"first edge 'ab': {key} {value!r}" in caplog.text


def test_speed_limits_may_differ_by_class(path: Path) -> None:
    """By the edge's type, and by the lanes that a class may use."""
    types = '<type id="autobahn" speed="36.11"><restriction vClass="trailer" speed="22.22"/></type>'
    lanes = lane("bc", 'disallow="trailer"', 1, 30.0)
    road = net(
        path,
        types,
        edge("ab", "a", "b", lane("ab", speed=36.11), 'type="autobahn"'),
        edge("bc", "b", "c", lane("bc", speed=20.0) + lanes),
    )
    limits = {
        (name, who): segment.access.speed_limit_mps(segment.speed_limit_mps, profile)
        for name, segment in road.segments.items()
        for who, profile in (("car", CAR), ("truck", TRUCK))
    }
    assert limits == {
        ("ab", "car"): 36.11,
        ("ab", "truck"): 22.22,
        ("bc", "car"): 30.0,
        ("bc", "truck"): 20.0,
    }


def test_what_is_not_known_of_a_vehicle_meets_no_limit() -> None:
    """At the limit it may still pass."""
    low = Access(max_height_m=3.0, max_mass_kg=3500.0)
    assert low.admits(CAR)
    assert low.admits(RoutingProfile(height_m=3.0, gross_mass_kg=3500.0))
    assert not low.admits(RoutingProfile(height_m=3.01))
    assert not low.admits(RoutingProfile(gross_mass_kg=3500.1))


@pytest.mark.slow
def test_points_are_projected_as_the_net_was() -> None:
    """Troy's own corners: its net says what they are in degrees and in metres."""
    path = Path("lab/slipstream_lab/simulation/scenarios/data/troy/troy.net.xml.gz")
    troy = load_network(Path(__file__).parents[3] / path)
    assert troy.projection is not None
    assert troy.projection.place_m(42.689698, -73.716015) == pytest.approx((0.0, 0.0), abs=90.0)
    x_min, y_min, x_max, y_max = troy.bounds_m()
    x, y = troy.projection.place_m(42.7284, -73.6918)
    assert x_min < x < x_max
    assert y_min < y < y_max
    with pytest.raises(ValueError, match="no place"):
        troy.projection.place_m(95.0, 200.0)


def test_a_place_is_snapped_to_the_nearest_road_that_may_be_used(path: Path) -> None:
    """The footway is nearer; vehicles stop at the nearer end of the street."""
    street = '<lane id="s_0" index="0" speed="10" length="200" shape="0,40 200,40"/>'
    foot = '<lane id="f_0" index="0" speed="2" length="200" shape="0,5 200,5" allow="pedestrian"/>'
    road = net(path, edge("f", "a", "c", foot), edge("s", "a", "c", street))
    snapper = Snapper(road, [VAN])
    found = snapper.nearest((150.0, 0.0))
    assert found is not None
    assert (found.segment, found.node) == ("s", "c")
    assert math.isclose(found.distance_m, 40.0, abs_tol=2.0)
    assert Snapper(road, [RoutingProfile(vehicle_class="moped")]).nearest((0.0, 0.0)) is not None
    closed = net(path, edge("f", "a", "c", foot))
    assert Snapper(closed, [VAN]).nearest((0.0, 0.0)) is None


def test_a_restriction_that_is_none_is_refused(path: Path) -> None:
    """One line, as for any faulty net."""
    types = '<type id="t"><restriction vClass="truck" speed="fast"/></type>'
    with pytest.raises(InputError, match="not a SUMO net"):
        net(path, types, edge("ab", "a", "b"))

"""Plans, nets and the tools that make them."""

from __future__ import annotations

import gzip
import os
import stat
from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest

from slipstream.errors import InputError
from slipstream.osm import largest_part
from slipstream.osm.importing import import_osm
from slipstream.osm.netconvert import find_netconvert
from slipstream.roads import RoadNetwork, Segment, build_network
from slipstream_lab.simulation.scenarios.networks.build import build_net
from slipstream_lab.simulation.scenarios.networks.corridor import (
    CorridorSettings,
    corridor_plan,
)
from slipstream_lab.simulation.scenarios.networks.fixed_time import write_fixed_time
from slipstream_lab.simulation.scenarios.networks.network import scenario_network
from slipstream_lab.simulation.scenarios.networks.plan import Junction, NetworkPlan, PlannedRoad
from slipstream_lab.simulation.scenarios.networks.route_files import check_routes
from slipstream_lab.simulation.scenarios.networks.troy import troy_plan
from slipstream_lab.simulation.scenarios.scenario import Scenario

DATA = Path(str(resources.files("slipstream_lab.simulation.scenarios") / "data"))
SIGNAL = '<tag k="highway" v="traffic_signals"/>'


@pytest.fixture
def netconvert(tool: Callable[[str], str]) -> None:
    """netconvert is installed, or the test is skipped."""
    if find_netconvert() is None:
        tool("netconvert")


def test_troy_plan_has_the_sources_roads_in_their_directions() -> None:
    """A road of both directions gives two segments, a one-way road one."""
    plan = troy_plan()
    ids = {road.id for road in plan.roads}
    assert len(plan.junctions) == 178
    assert len(ids) == 470
    assert {"us4_mazoway-us4_williams", "us4_williams-us4_mazoway"} <= ids
    assert "4th_broadway-4th_fulton" in ids
    assert "4th_fulton-4th_broadway" not in ids


@pytest.mark.parametrize(
    ("name", "least_km", "signals"), [("troy", 170.0, 60), ("corridor", 140.0, 20)]
)
def test_shipped_nets_are_in_one_piece_with_signals(
    name: str, least_km: float, signals: int
) -> None:
    """The shipped nets load whole, with their plan's segments, speeds and signals."""
    network = scenario_network(DATA / name / f"{name}.net.xml.gz")
    plan = troy_plan() if name == "troy" else corridor_plan(CorridorSettings())
    assert {road.id for road in plan.roads} == set(network.segments)
    for road in plan.roads:
        segment = network.segments[road.id]
        assert (segment.start, segment.end, segment.lanes) == (road.start, road.end, road.lanes)
        assert segment.speed_limit_mps == pytest.approx(road.speed_mps, abs=0.01)
    assert sum(s.length_m for s in network.segments.values()) / 1000 > least_km
    assert len(network.signals) >= signals


@pytest.mark.usefixtures("netconvert")
@pytest.mark.parametrize("name", ["troy", "corridor"])
def test_rebuilt_net_is_the_shipped_one(name: str, tmp_path: Path) -> None:
    """Where netconvert is installed, the sources give the net that ships."""
    plan = troy_plan() if name == "troy" else corridor_plan(CorridorSettings())
    build_net(plan, tmp_path / "again.net.xml.gz")
    shipped = gzip.decompress((DATA / name / f"{name}.net.xml.gz").read_bytes())
    assert gzip.decompress((tmp_path / "again.net.xml.gz").read_bytes()) == shipped


@pytest.mark.usefixtures("netconvert")
def test_an_openstreetmap_extract_becomes_a_net_that_a_day_can_run_on(tmp_path: Path) -> None:
    """Roads for cars are kept with their lanes and limits, footways and loose ends are not."""
    nodes = [
        f'<node id="{10 * i + j + 1}" lat="{42.73 + 0.003 * i}" lon="{-73.69 + 0.004 * j}">'
        f"{SIGNAL if 0 < i < 4 and 0 < j < 4 else ''}</node>"
        for i in range(5)
        for j in range(5)
    ]
    rows = [[10 * i + j + 1 for j in range(5)] for i in range(5)]
    streets = [*rows, *([row[j] for row in rows] for j in range(5))]
    kinds = {"secondary": streets, "footway": [[1, 12, 23]], "residential": [[101, 102]]}
    nodes += [f'<node id="{101 + k}" lat="42.8" lon="{-73.6 + 0.001 * k}"/>' for k in range(2)]
    ways = [(kind, way) for kind, of_kind in kinds.items() for way in of_kind]
    for number, (kind, way) in enumerate(ways, start=1):
        refs = "".join(f'<nd ref="{node}"/>' for node in way)
        tags = f'<tag k="highway" v="{kind}"/><tag k="lanes" v="2"/><tag k="maxspeed" v="30 mph"/>'
        nodes.append(f'<way id="{number}">{refs}{tags}</way>')
    extract = tmp_path / "town.osm"
    extract.write_text(f'<osm version="0.6">{"".join(nodes)}</osm>')
    import_osm(extract, tmp_path / "town.net.xml.gz")
    network = scenario_network(tmp_path / "town.net.xml.gz")
    # Two directions of 40 blocks; at the four corners, which are no junctions, two become one.
    assert len(network.segments) == 2 * (2 * 5 * 4 - 4)
    assert len(network.signals) == 9
    assert {s.lanes for s in network.segments.values()} == {1}
    assert {round(s.speed_limit_mps, 1) for s in network.segments.values()} == {13.4}


def test_missing_netconvert_is_told_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the tool one line says where to get it."""
    monkeypatch.setattr("slipstream.osm.netconvert.find_netconvert", lambda: None)
    with pytest.raises(InputError, match="not installed; pip install eclipse-sumo"):
        build_net(troy_plan(), tmp_path / "x.net.xml")


def test_netconverts_refusal_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What netconvert says goes into the error, its options do not."""
    tool = tmp_path / "bin" / "netconvert"
    tool.parent.mkdir()
    tool.write_text("#!/bin/sh\necho 'Error: no edges loaded.' >&2\nexit 1\n")
    tool.chmod(tool.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(tool.parent), prepend=os.pathsep)
    monkeypatch.setenv("SUMO_HOME", str(tmp_path))
    with pytest.raises(InputError, match="netconvert refuses it: no edges loaded"):
        build_net(corridor_plan(CorridorSettings()), tmp_path / "x.net.xml")
    with pytest.raises(InputError, match="no such file"):
        import_osm(tmp_path / "missing.osm", tmp_path / "x.net.xml")


def test_bad_sources_name_file_and_line(tmp_path: Path) -> None:
    """A row that is no road, and a road to nowhere, are told with where they stand."""
    (tmp_path / "junctions.csv").write_text(
        "id,name,lat_deg,lon_deg,control,position\na,A,42.7,-73.6,signals,estimated\n"
        "b,B,42.8,-73.6,priority,estimated\n"
    )
    head = "from,to,street,class,lanes,speed_limit_mps,one_way\n"
    roads = tmp_path / "roads.csv"
    roads.write_text(f"{head}a,b,Main St,arterial,many,13.4,0\n")
    with pytest.raises(InputError, match=r"roads.csv: line 2: lanes"):
        troy_plan(tmp_path)
    roads.write_text(f"{head}a,c,Main St,arterial,1,13.4,0\n")
    with pytest.raises(InputError, match="no junction 'c'"):
        troy_plan(tmp_path)
    roads.write_text(head)
    with pytest.raises(InputError, match="an empty table"):
        troy_plan(tmp_path)


def test_plan_with_a_road_twice_is_refused() -> None:
    """A plan may be without signals, as a motorway is."""
    ends = (Junction("a", 0, 0, "priority"), Junction("b", 100, 0, "priority"))
    plan = NetworkPlan("x", ends, (PlannedRoad("ab", "a", "b", 1, 10.0, 1),))
    plan.check("x")
    with pytest.raises(InputError, match="two roads with this id"):
        replace(plan, roads=plan.roads * 2).check("x")


def test_corridor_ramps_join_and_leave_by_a_lane_of_their_own(corridor: Scenario) -> None:
    """The motorway's lanes run through; an interchange's extra lane leads to or from its ramp."""
    network = corridor.network
    assert network.follows["e3_leave"] == ("e3_mid", "e3_off")
    assert network.follows["e3_join"] == ("e3_main",)
    assert network.follows["e3_on"] == ("e3_join",)
    assert set(network.follows["e3_off"]) == {"s3-ts3", "s3-n3"}  # not the ramp back
    lanes = [network.segments[f"e3_{part}"].lanes for part in ("leave", "mid", "join", "main")]
    assert lanes == [3, 2, 3, 2]
    driven = sum(network.segments[name].length_m for name in motorway(network))
    assert driven == pytest.approx(2 * 40_000, rel=0.01)


def test_no_corridor_ramp_is_slowed_where_it_meets_the_motorway() -> None:
    """Its kink on the drawing is no bend: who joins would brake from 20 to 8 m/s for it."""
    net = gzip.decompress((DATA / "corridor" / "corridor.net.xml.gz").read_bytes())
    root = ElementTree.fromstring(net)
    limit_mps = {lane.get("id"): float(lane.get("speed", 0)) for lane in root.iter("lane")}
    ramps = {
        (turn.get("from"), turn.get("to")): limit_mps[turn.get("via")]
        for turn in root.iter("connection")
        if (turn.get("from") or "")[-3:] == "_on" or (turn.get("to") or "")[-4:] == "_off"
        if turn.get("via") is not None
    }
    assert len(ramps) == 2 * 20
    assert set(ramps.values()) == {CorridorSettings().ramp_speed_mps}


def test_corridor_rsus_watch_every_segment_of_the_motorway(corridor: Scenario) -> None:
    """No part of it is without one."""
    assert corridor.rsus is not None
    watched = {stretch.segment for rsu in corridor.rsus for stretch in rsu.watch}
    assert watched == motorway(corridor.network)


def motorway(network: RoadNetwork) -> set[str]:
    """Its segments of both directions, without ramps and streets."""
    ends = ("_leave", "_mid", "_join", "_main")
    return {name for name in network.segments if name.endswith(ends)}


def test_corridor_too_short_for_its_interchanges_is_refused() -> None:
    """Interchanges that overlap would be a net of another shape."""
    with pytest.raises(InputError, match="do not fit"):
        corridor_plan(
            CorridorSettings(spacing_m=2500, ramp_spacing_m=1500, acceleration_lane_m=800)
        )


def _line(names: str) -> RoadNetwork:
    places = {name: (100.0 * i, 0.0) for i, name in enumerate(names)}
    segments = [
        Segment(a + b, a, b, 100.0, 10.0, 1, (places[a], places[b])) for a, b in pairwise(names)
    ]
    return build_network("line", segments, places, signals=names[:1])


def test_a_net_in_pieces_is_refused_and_a_dead_end_cut_off() -> None:
    """The largest part must hold most of the roads; what little hangs on it is left out."""
    with pytest.raises(InputError, match="in pieces"):
        largest_part(_line("abcd"), "x")
    ring = _line("abcdea"[:5])
    back = Segment("ea", "e", "a", 100.0, 10.0, 1, ((400.0, 0.0), (0.0, 0.0)))
    dead = Segment("ef", "e", "f", 20.0, 10.0, 1, ((400.0, 0.0), (420.0, 0.0)))
    whole = build_network(
        "ring",
        [*ring.segments.values(), back, dead],
        {**ring.junctions, "f": (420.0, 0.0)},
        signals=["a"],
    )
    kept = largest_part(whole, "x")
    assert set(kept.segments) == {"ab", "bc", "cd", "de", "ea"}
    assert "f" not in kept.junctions


def test_a_net_without_signals_is_a_scenario(tmp_path: Path) -> None:
    """A motorway has none; fixed times of no signals are an additional file without any."""
    path = Path(str(resources.files("slipstream") / "data" / "demo.net.xml"))
    network = scenario_network(path)
    assert network.segments
    assert not network.signals
    fixed = tmp_path / "fixed.add.xml"
    assert write_fixed_time(path, fixed) == 0
    assert len(ElementTree.parse(fixed).getroot()) == 0


def test_fixed_time_signals_keep_the_phases_of_the_actuated_ones(
    troy: Scenario, tmp_path: Path
) -> None:
    """Each signal gets a static program with the phases that the net gives it."""
    path = tmp_path / "fixed.add.xml"
    assert write_fixed_time(troy.net, path) == len(troy.network.signals)
    programs = {logic.get("id"): logic for logic in ElementTree.parse(path).getroot()}
    with gzip.open(troy.net) as file:
        originals = ElementTree.parse(file).getroot().findall("tlLogic")
    for original in originals:
        logic = programs[original.get("id")]
        assert logic.get("type") == "static"
        assert [p.get("state") for p in logic] == [p.get("state") for p in original.iter("phase")]


def test_route_file_of_another_net_is_refused(tmp_path: Path) -> None:
    """An edge that the net has not, or no vehicle at all, is told in one line."""
    path = tmp_path / "x.rou.xml"
    path.write_text('<routes><route id="r" edges="ab nowhere"/></routes>')
    with pytest.raises(InputError, match="a route over 'nowhere', which the net has not"):
        check_routes((path,), ["ab"])
    path.write_text('<routes><route id="r" edges="ab"/></routes>')
    with pytest.raises(InputError, match="no vehicle in it"):
        check_routes((path,), ["ab"])
    whole = '<routes><vehicle id="v" depart="0"><route edges="ab"/></vehicle></routes>'
    path.write_text(whole)
    check_routes((path,), ["ab"])
    packed = tmp_path / "x.rou.xml.gz"
    packed.write_bytes(gzip.compress(whole.encode()))
    check_routes((packed,), ["ab"])


@pytest.mark.parametrize("name", ["x.rou.xml", "x.rou.xml.gz"])
def test_a_route_file_cut_off_in_the_middle_is_one_line(tmp_path: Path, name: str) -> None:
    """As a full disk or an interrupted copy leaves it."""
    path = tmp_path / name
    vehicle = '<vehicle id="v{}" depart="{}"><route edges="ab"/></vehicle>'
    whole = "<routes>" + "".join(vehicle.format(i, i) for i in range(5000)) + "</routes>"
    content = gzip.compress(whole.encode()) if path.suffix == ".gz" else whole.encode()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match=f"{name}: not XML"):
        check_routes((path,), ["ab"])

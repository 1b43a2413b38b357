"""Whatever is wrong with a SUMO view's files, one line says so and the exit status is 2."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from slipstream.errors import InputError
from slipstream_cli.main import main
from slipstream_lab.simulation.rsus import load_rsu
from slipstream_lab.simulation.sumo_view import SumoClipSettings
from slipstream_lab.simulation.sumo_view.examples import RSUS, find_net, find_routes, find_rsu
from slipstream_lab.simulation.sumo_view.lanes import LaneRoads
from slipstream_lab.simulation.sumo_view.net import read_roads
from slipstream_lab.simulation.sumo_view.pose import CameraSite, draw_pose
from slipstream_lab.simulation.sumo_view.watched_segments import (
    SegmentStretch,
    View,
    choose_stretches,
)
from slipstream_lab.simulation.sumo_view.world import SumoViewWorld

RSU = find_rsu("approach").read_text()
ROUTES = "<routes>{}</routes>"


def refused(capfd: pytest.CaptureFixture[str], *options: str) -> str:
    """The one line with which `clip sumo` refuses its options."""
    assert main(["clip", "sumo", "--seconds", "0.2", "--begin", "2", *options]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert len(err.strip().splitlines()) == 1
    return err


@pytest.mark.long
@pytest.mark.parametrize(
    ("option", "content", "told"),
    [
        ("--net", None, "no such file"),
        ("--net", "no xml", "not XML"),
        ("--net", ROUTES.format(""), "no SUMO net"),
        ("--net", "<net><edge", "SUMO crashes on them"),
        ("--routes", None, "no such file"),
        ("--routes", "no xml", "not XML"),
        ("--routes", "<net/>", "where vehicles belong"),
        ("--routes", ROUTES.format(""), "no vehicle drives"),
        (
            "--routes",
            ROUTES.format('<vehicle id="a" depart="0"><route edges="nowhere"/></vehicle>'),
            "'nowhere'",
        ),
        ("--routes", ROUTES.format('<vType id="a" vClass="spaceship"/>'), "'spaceship'"),
        ("--additional", None, "no such file"),
        ("--additional", '<additional><poi id="a"/></additional>', "SUMO refuses it"),
        ("--rsu", None, "no such file"),
        ("--rsu", "schema =", "not TOML"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, capfd, option, content, told):
    """One line names the file and what is wrong with it."""
    path = tmp_path / "file.xml"
    if content is not None:
        path.write_text(content)
    camera = ("--rsu", "approach") if option == "--net" else ()
    line = refused(capfd, "--out", str(tmp_path / "clip"), option, str(path), *camera)
    assert "file.xml" in line
    assert told.lower() in line.lower()


@pytest.fixture(scope="module")
def roads() -> LaneRoads:
    """The built-in avenue around the RSU `approach`."""
    with SumoViewWorld(find_net("avenue"), (find_routes("calm"),), (), 1):
        return read_roads(95.0, 9.2, 320.0)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"west-2"', '"nowhere"', "watch.nowhere: no such edge in the net"),
        ('"west-2"', '"south-in"', "watch.south-in: the edge is not in view"),
        ('"west-2"', '"west-2"\nfrom_m = 0\nto_m = 290', "watch.west-2: 0 to 290 m cannot be"),
        ('"west-2"', '"west-2"\nfrom_m = 200\nto_m = 205', "watch.west-2: 200 to 205 m cannot be"),
        ('"west-2"', '"west-2"\nto_m = 999', "watch.west-2: 999 m is beyond its 302.8 m"),
        (
            '"west-2"',
            '"west-2"\nfrom_lane = 2',
            "watch.west-2: it has no lane 2; lanes count from 0",
        ),
        ('[[watch]]\nedge = "west-2"\n\n[[watch]]\nedge = "east-1"\n', "", "no edge is in view"),
    ],
)
def test_edges_that_cannot_be_watched_are_refused(tmp_path: Path, roads, old, new, told):
    """Unknown edges, edges out of view, stretches out of view: one line says which and why."""
    assert old in RSU
    text = RSU.replace(old, new)
    if new == "":  # turned away from the road
        text = text.replace("[134.0, 1.0]", "[95.0, 60.0]")
    path = tmp_path / "rsu.toml"
    with pytest.raises(InputError) as caught:
        chosen(text, path, roads)
    assert str(path) in str(caught.value)
    assert told in str(caught.value)


def chosen(text: str, path: Path, roads: LaneRoads) -> tuple[SegmentStretch, ...]:
    """What an RSU file has its camera watch."""
    path.write_text(text)
    rsu = load_rsu(path)
    pose = draw_pose(rsu, 1, path)
    view = View(pose.camera(pose.heading_rad), CameraSite(pose.x_m, pose.y_m, pose.heading_rad))
    return choose_stretches(rsu, roads, view, path)


def test_lanes_to_the_right_can_be_left_out(tmp_path: Path, roads):
    """The outline is that of the lanes from the left to the rightmost one that is watched."""
    text = RSU.replace('"west-2"', '"west-2"\nfrom_lane = 1')
    (left, both) = chosen(text, tmp_path / "rsu.toml", roads)
    assert (left.lanes, both.lanes) == (1, 2)
    assert sorted({round(float(abs(y)), 2) for _, y in left.polygon}) == [0.0, 3.5]
    assert sorted({round(float(abs(y)), 2) for _, y in both.polygon}) == [0.0, 7.0]


def test_a_camera_cannot_look_at_its_own_foot(tmp_path: Path):
    """A point looked at below the mast raises InputError."""
    path = tmp_path / "rsu.toml"
    path.write_text(RSU.replace("[134.0, 1.0]", "[95.0, 9.2]").replace("spread_m", "#"))
    with pytest.raises(InputError, match="own foot"):
        draw_pose(load_rsu(path), 1, path)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"seconds": 0.0}, "seconds"),
        ({"seconds": float("nan")}, "seconds"),
        ({"fps": 100.0}, "fps"),
        ({"begin_s": -1.0}, "begin"),
        ({"seed": -1}, "seed"),
    ],
)
def test_settings_out_of_range_are_refused(change, key):
    """A wrong setting raises InputError that names its key."""
    settings = SumoClipSettings(find_net("avenue"), (find_routes("calm"),), find_rsu("bend"))
    with pytest.raises(InputError) as caught:
        replace(settings, **change)
    assert caught.value.key == key


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("look_at_m = [134.0, 1.0]", "heading_deg = 90", "view"),
        ("look_at_m = [134.0, 1.0]", "", "view"),
        ("look_at_m", "pitch_deg = 15\nheading_deg = 90\nlook_at_m", "view"),
        ('edge = "east-1"', 'edge = "west-2"', "watch.id"),
        ('edge = "east-1"', 'edge = "east-1"\nfrom_m = 5\nto_m = 4', "watch.east-1"),
        ("schema = 1", "schema = 2", "schema"),
        ("spread_m = 0.6", "spread = 0.6", "mast.spread"),
        ("spread_m = 0.6", "height_m = 0.1", "mast.height_m"),
    ],
)
def test_rsu_files_are_checked(tmp_path: Path, old, new, key):
    """A contradictory or misspelt RSU file raises InputError that names the key."""
    path = tmp_path / "rsu.toml"
    assert old in RSU
    path.write_text(RSU.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_rsu(path)
    assert caught.value.key == key


@pytest.mark.parametrize("name", RSUS)
def test_built_in_rsus_are_sound(name):
    """Each built-in RSU file carries its own name and leaves the camera's values to the seed."""
    rsu = load_rsu(find_rsu(name))
    assert rsu.name == name
    assert (rsu.mast.height_m, rsu.view.focal_px) == (None, None)
    assert len(rsu.watch) == 2

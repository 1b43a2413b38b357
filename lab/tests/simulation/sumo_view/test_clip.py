"""SUMO views are reproducible, and their truth is SUMO's own and agrees with the pictures."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import libsumo
import numpy as np
import pytest

from edge_daemon.camera import Camera, load_camera
from lab.tests.simulation.conftest import Clip, read_clip
from slipstream.errors import InputError
from slipstream_lab.simulation.streetdrive.vehicles.catalogue import CLASSES
from slipstream_lab.simulation.streetdrive.writer import TRUTH_COLUMNS
from slipstream_lab.simulation.sumo_view import SumoClipSettings, render_sumo_clip
from slipstream_lab.simulation.sumo_view.examples import (
    find_additional,
    find_net,
    find_routes,
    find_rsu,
)
from slipstream_lab.simulation.sumo_view.world import SumoViewWorld

FILES = ("video.mp4", "truth.csv", "camera.toml")


def small_rsu(folder: Path, name: str) -> Path:
    """A built-in RSU with a small picture."""
    text = find_rsu(name).read_text().replace("[view]", "[view]\nwidth_px = 480\nheight_px = 270")
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def settings_for(folder: Path, rsu: str, routes: str = "calm") -> SumoClipSettings:
    """A short clip of the built-in avenue."""
    return SumoClipSettings(
        net=find_net("avenue"),
        routes=(find_routes(routes),),
        additional=find_additional(routes, []),
        rsu=small_rsu(folder, rsu),
        seconds=1.2,
        fps=25.0,
        begin_s=25.0,
        seed=4,
    )


@dataclass(frozen=True)
class SumoClip(Clip):
    """A rendered clip with what it was made from."""

    settings: SumoClipSettings
    calibrated: Camera


def render(folder: Path, settings: SumoClipSettings) -> SumoClip:
    """Render a clip and read it back."""
    render_sumo_clip(settings, folder / "clip")
    clip = read_clip(folder / "clip")
    camera = load_camera(clip.folder / "camera.toml")
    return SumoClip(clip.folder, clip.rows, clip.camera, settings, camera)


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> SumoClip:
    """Stop-and-go on the straight avenue; frames fall on SUMO's steps."""
    folder = tmp_path_factory.mktemp("straight")
    return render(folder, settings_for(folder, "approach", "rough"))


@pytest.fixture(scope="module")
def bend(tmp_path_factory: pytest.TempPathFactory) -> SumoClip:
    """Calm traffic through the bend; frames fall between SUMO's steps."""
    folder = tmp_path_factory.mktemp("bend")
    return render(folder, replace(settings_for(folder, "bend"), fps=30.0))


@contextmanager
def plain_sumo(settings: SumoClipSettings) -> Iterator[None]:
    """The clip's simulation without the clip."""
    with SumoViewWorld(settings.net, settings.routes, settings.additional, settings.seed):
        libsumo.simulationStep(settings.begin_s)
        yield


@pytest.mark.long
def test_same_seed_gives_the_same_bytes(tmp_path, straight):
    """Video, truth and calibration are equal byte for byte when rendered again."""
    render_sumo_clip(straight.settings, tmp_path)
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (straight.folder / name).read_bytes(), name
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(FILES)


def test_truth_has_streetdrives_columns_and_classes(straight):
    """The header is that of StreetDrive's truth, and more than one class drives by."""
    header = (straight.folder / "truth.csv").read_text().splitlines()[0]
    assert tuple(header.split(",")) == TRUTH_COLUMNS
    classes = {row["class"] for row in straight.rows}
    assert classes <= set(CLASSES)
    assert len(classes) >= 3


def test_truth_is_sumos(straight):
    """In each frame each row is a vehicle of SUMO: place, speed, acceleration, length, width."""
    frames = defaultdict(list)
    for row in straight.rows:
        frames[int(row["frame"])].append(row)
    assert len(frames) == straight.settings.frames
    names: dict[float, str] = {}
    with plain_sumo(straight.settings):
        for frame in range(straight.settings.frames):
            known = {}
            for name in libsumo.vehicle.getIDList():
                x, y = libsumo.vehicle.getPosition(name)
                length = libsumo.vehicle.getLength(name)
                angle = math.radians(libsumo.vehicle.getAngle(name))
                # SUMO's position is the front bumper's middle, its angle is from north.
                centre = (x - length / 2 * math.sin(angle), y - length / 2 * math.cos(angle))
                known[name] = np.array(centre)
            for row in frames[frame]:
                place = np.array([row["x_m"], row["y_m"]])
                name = min(known, key=lambda n: float(np.linalg.norm(known[n] - place)))
                assert np.linalg.norm(known[name] - place) < 1e-3
                assert names.setdefault(row["vehicle_id"], name) == name
                assert row["length_m"] == pytest.approx(libsumo.vehicle.getLength(name), abs=1e-3)
                assert row["width_m"] == pytest.approx(libsumo.vehicle.getWidth(name), abs=1e-3)
                if libsumo.vehicle.getRoadID(name) not in ("east-1", "west-2"):
                    continue  # in the bend a lane's driven length is not its drawn one
                assert row["speed_mps"] == pytest.approx(libsumo.vehicle.getSpeed(name), abs=1e-3)
                acceleration = libsumo.vehicle.getAcceleration(name)
                assert row["acceleration_mps2"] == pytest.approx(acceleration, abs=1e-3)
            libsumo.simulationStep()
            libsumo.simulationStep()
    assert len(set(names.values())) == len(names) > 20


@pytest.mark.parametrize("clip_name", ["straight", pytest.param("bend", marks=pytest.mark.long)])
def test_calibration_maps_truth_into_the_boxes(clip_name, request):
    """Footprints, turned as the vehicles drive and mapped by camera.toml, lie in the boxes."""
    clip = request.getfixturevalue(clip_name)
    tracks = defaultdict(list)
    for row in clip.rows:
        tracks[row["vehicle_id"]].append(row)
    whole = 0
    for rows in tracks.values():
        way = np.array(
            [rows[-1]["x_m"] - rows[0]["x_m"], rows[-1]["y_m"] - rows[0]["y_m"]], dtype=np.float64
        )
        if np.linalg.norm(way) < 5.0:
            continue
        forward = way / np.linalg.norm(way)
        row = rows[len(rows) // 2]
        x1, y1, x2, y2 = (row[k] for k in ("x1_px", "y1_px", "x2_px", "y2_px"))
        if x1 < 1 or y1 < 1 or x2 > 479 or y2 > 269:
            continue
        left = np.array([-forward[1], forward[0]])
        # Tyres stop a little short of the bumpers, so the corners shrink to their contact area.
        corners = [
            np.array([row["x_m"], row["y_m"]])
            + a * row["length_m"] / 2 * forward
            + b * row["width_m"] / 2 * left
            for a in (-0.5, 0.5)
            for b in (-0.7, 0.7)
        ]
        u, v = clip.calibrated.to_image(np.array(corners)).T
        whole += 1
        assert x1 - 1 <= u.min() <= u.max() <= x2 + 1
        assert y1 - 1 <= v.min() <= v.max() <= y2 + 1
        assert y2 - v.max() < 0.3 * (y2 - y1) + 1
    assert whole > 10


@pytest.mark.long
def test_vehicles_are_drawn_where_truth_says(bend):
    """Between two pictures 1 s apart, boxes of moving vehicles change and the sky does not."""
    capture = cv2.VideoCapture(str(bend.folder / "video.mp4"))
    pictures = [capture.read()[1].astype(np.int16) for _ in range(31)]
    assert pictures[0].shape == (270, 480, 3)
    change = np.abs(pictures[30] - pictures[0]).max(axis=2)
    moving = [
        row
        for row in bend.rows
        if row["frame"] == 0
        and row["visible_fraction"] > 0.6
        and row["y2_px"] - row["y1_px"] > 14
        and row["y2_px"] < 265
    ]
    assert len(moving) >= 3
    for row in moving:
        x1, y1, x2, y2 = (int(row[k]) for k in ("x1_px", "y1_px", "x2_px", "y2_px"))
        assert np.mean(change[y1:y2, x1:x2] > 20) > 0.35
    assert np.mean(change[:15] > 25) < 0.01


def test_camera_watches_the_edges_lanes(straight):
    """Each segment is an edge: its lanes' outline, direction of travel, lanes and lane width."""
    # The avenue's axis is y = 0; its lanes are 3.5 m wide and keep to the right.
    for segment, sign in zip(straight.calibrated.segments, (-1.0, 1.0), strict=True):
        x, y = segment.polygon_m.T
        assert segment.id == {-1.0: "west-2", 1.0: "east-1"}[sign]
        assert segment.direction == pytest.approx([sign, 0.0])
        assert sorted({round(float(v), 2) for v in y}) == sorted({0.0, -7.0 * sign})
        assert (segment.lanes, segment.lane_width_m) == (2, 3.5)
        mast_m = np.hypot(x - 95.0, y - 9.2)
        assert mast_m.min() > 18
        assert mast_m.max() < 82
        assert x.max() - x.min() > 50
        u, v = straight.calibrated.to_image(segment.polygon_m).T
        assert 0 <= u.min() <= u.max() <= 480
        assert 0 <= v.min() <= v.max() <= 270
    assert len(straight.camera["points"]) >= 8
    assert straight.calibrated.reprojection_error_px < 0.01


def test_one_simulation_a_process(straight):
    """A second simulation is refused while one runs, and the first is closed at its end."""
    settings = straight.settings
    with SumoViewWorld(settings.net, settings.routes, (), 1):
        assert libsumo.isLoaded()
        with pytest.raises(RuntimeError), SumoViewWorld(settings.net, settings.routes, (), 1):
            pass
        assert libsumo.isLoaded()
    assert not libsumo.isLoaded()


@pytest.mark.slow
def test_a_failed_clip_leaves_nothing_behind(tmp_path, straight):
    """A vehicle that cannot be drawn ends the clip, and no file is left."""
    routes = tmp_path / "tram.rou.xml"
    routes.write_text(
        '<routes><vType id="t" vClass="tram"/>'
        '<flow id="f" type="t" begin="0" end="99" period="3" from="east-1" to="east-3"/></routes>'
    )
    settings = replace(straight.settings, routes=(routes,), additional=())
    with pytest.raises(InputError, match="tram"):
        render_sumo_clip(settings, tmp_path / "clip")
    assert list((tmp_path / "clip").iterdir()) == []

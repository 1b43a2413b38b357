"""The part of the picture that is searched, and its way into a network's input and back."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_daemon.camera import Camera, load_camera
from edge_daemon.camera.segment import WatchedSegment
from edge_daemon.detection.placement import Placement, place_aligned, place_dynamic, place_static
from edge_daemon.detection.region import MARGIN_M, Region, road_region

PICTURE = (1280, 720)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of dense traffic with its truth."""
    from slipstream_lab.simulation.streetdrive.clip import ClipSettings, render_clip

    folder = tmp_path_factory.mktemp("clip")
    render_clip(ClipSettings(seconds=1.0, fps=5, scenario="turbulent", seed=5), folder)
    return folder


@pytest.mark.long
def test_every_vehicle_on_a_segment_is_whole(clip: Path) -> None:
    """True boxes of vehicles that stand on a segment, the margin included, lie in the region."""
    camera = load_camera(clip / "camera.toml")
    region = road_region(camera)
    assert region is not None
    assert region.width * region.height < 0.8 * PICTURE[0] * PICTURE[1]
    seen = 0
    for row in csv.DictReader((clip / "truth.csv").read_text().splitlines()):
        x1, y1, x2, y2 = (float(row[key]) for key in ("x1_px", "y1_px", "x2_px", "y2_px"))
        if x1 <= 0 or x2 >= PICTURE[0] - 1 or y2 >= PICTURE[1] - 1:
            continue
        foot = camera.to_road([[(x1 + x2) / 2, y2]])[0]
        for segment in camera.segments:
            shifts = np.array([-MARGIN_M, 0.0, MARGIN_M])[:, None] * segment.direction
            if segment.contains(foot + shifts).any():
                seen += 1
                assert x1 >= region.left
                assert y1 >= region.top
                assert x2 <= region.right
                assert y2 <= region.bottom
    assert seen > 20


def straight_down(height_m: float) -> Camera:
    """A camera that looks straight down on a road of 20 m."""
    outline = np.array([[-10.0, -2.0], [10.0, -2.0], [10.0, 2.0], [-10.0, 2.0]])
    focal = 1000.0
    pixels = np.array([640.0, 360.0]) + focal / height_m * outline * np.array([1, -1])
    segment = WatchedSegment("s", outline, np.array([1.0, 0.0]), 20.0, 1, 4.0)
    return Camera("down", PICTURE, outline, pixels, (segment,))


def test_seen_from_above_a_lorry_needs_half_its_length_at_both_ends() -> None:
    """There the middle of the lower edge is half a length from each end of the box."""
    region = road_region(straight_down(50.0))
    assert region is not None
    per_m = 1000 / 50
    half = (10 + MARGIN_M + 16.5 / 2) * per_m
    assert region.left == pytest.approx(640 - half - 8, abs=2)
    assert region.right == pytest.approx(640 + half + 8, abs=2)


def test_a_road_at_the_horizon_has_no_region() -> None:
    """Where the outline comes near the horizon all of the picture is searched."""
    road = np.array([[10.0, -5.0], [10.0, 5.0], [60.0, -5.0], [60.0, 5.0]])
    height_m, focal = 8.0, 900.0
    pixels = np.column_stack(
        [640 - focal * road[:, 1] / road[:, 0], 200 + focal * height_m / road[:, 0]]
    )
    outline = np.array([[1.0, -2.0], [50.0, -2.0], [50.0, 2.0], [1.0, 2.0]])
    segment = WatchedSegment("s", outline, np.array([1.0, 0.0]), 49.0, 1, 4.0)
    assert road_region(Camera("low", PICTURE, road, pixels, (segment,))) is None


@given(
    left=st.integers(0, 1000),
    top=st.integers(0, 600),
    width=st.integers(1, 1280),
    height=st.integers(1, 720),
    scale=st.sampled_from([0.25, 1 / 3, 0.5, 0.61, 1.0, 1.7]),
)
def test_a_free_input_holds_what_is_wanted(
    left: int, top: int, width: int, height: int, scale: float
) -> None:
    """The crop holds the wanted part, within the picture; the input is of whole strides."""
    wanted = Region(left, top, min(1280, left + width), min(720, top + height))
    for place in (place_dynamic, place_aligned):
        holds(place(PICTURE, wanted, scale), wanted, scale)


def holds(got: Placement, wanted: Region, scale: float) -> None:
    """What a placement promises."""
    assert 0 <= got.crop.left <= wanted.left
    assert 0 <= got.crop.top <= wanted.top
    assert wanted.right <= got.crop.right <= 1280
    assert wanted.bottom <= got.crop.bottom <= 720
    assert got.shape[0] % 32 == got.shape[1] % 32 == 0
    assert got.inner.left >= 0
    assert got.inner.top >= 0
    assert got.inner.right <= got.shape[1]
    assert got.inner.bottom <= got.shape[0]
    assert got.inner.width / got.crop.width == pytest.approx(scale, rel=0.02, abs=1 / 32)


def test_a_whole_picture_is_laid_out_as_in_training() -> None:
    """1280×720 at a half: 640×360 in the middle of 640×384."""
    got = place_dynamic(PICTURE, Region(0, 0, *PICTURE), 0.5)
    assert got.shape == (384, 640)
    assert got.inner == Region(0, 12, 640, 372)


@pytest.mark.parametrize("scale", [0.5, 0.25, 1.0])
def test_an_aligned_part_lies_as_in_the_whole_picture(scale: float) -> None:
    """Between the multiples of 32 px a point is where it is if all of the picture is searched."""
    whole = place_aligned(PICTURE, Region(0, 0, *PICTURE), scale)
    assert whole == place_dynamic(PICTURE, Region(0, 0, *PICTURE), scale)
    part = place_aligned(PICTURE, Region(410, 130, 1275, 600), scale)
    assert part.shape[0] * part.shape[1] < 0.9 * whole.shape[0] * whole.shape[1]
    place = np.array([[500.0, 300.0]])
    in_whole, in_part = (
        np.array([got.inner.left, got.inner.top])
        + scale * (place - np.array([got.crop.left, got.crop.top]))
        for got in (whole, part)
    )
    assert ((in_whole - in_part) % 32 == 0).all()


def test_a_fixed_input_keeps_the_aspect() -> None:
    """The wanted part is letterboxed, and boxes find their way back."""
    got = place_static(PICTURE, Region(200, 100, 840, 420), (640, 640))
    assert got.inner == Region(0, 160, 640, 480)
    boxes = np.array([[0.0, 160.0, 640.0, 480.0], [320, 320, 330, 340]], dtype=np.float32)
    assert got.to_picture(boxes).tolist() == [[200, 100, 840, 420], [520, 260, 530, 280]]


def test_boxes_cut_off_by_the_crop_are_not_whole() -> None:
    """Except where the crop ends with the picture: that border is judged later."""
    got = Placement(PICTURE, Region(0, 100, 640, 420), (160, 320), Region(0, 0, 320, 160))
    boxes = np.array(
        [
            [0, 200, 60, 260],  # at the picture's own left border
            [500, 200, 638, 260],  # at the crop's right border
            [300, 380, 360, 420],  # at its lower border
            [300, 100, 360, 160],  # at its upper one: the foot is seen
            [300, 200, 360, 260],
        ],
        dtype=np.float32,
    )
    assert got.uncut(boxes).tolist() == [True, False, False, True, True]

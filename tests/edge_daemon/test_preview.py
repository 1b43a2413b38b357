"""The annotated picture."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from edge_daemon.camera import Camera
from edge_daemon.drawing import Labels
from edge_daemon.frame import Image
from edge_daemon.preview import annotate, draw_time, past_picture, utc_date_and_time, utc_time
from edge_daemon.tracking import Track
from slipstream.messages import SegmentState

from .conftest import project

STATE = SegmentState(
    rsu="r",
    segment="approach",
    sequence=0,
    time_ns=0,
    window_s=10.0,
    features=None,
    y_e=None,
    reason="too_few_vehicles",
    vehicles=0,
    frames=0,
    coverage=0.0,
)


@pytest.fixture
def picture() -> Image:
    """A grey one of the camera's size."""
    return np.full((720, 1280, 3), 90, dtype=np.uint8)


def track(
    number: int,
    box: tuple[float, float, float, float],
    last_seen_s: float,
    y_m: float = 3.0,
    followed_s: float = 2.0,
) -> Track:
    """A vehicle at 10 m/s."""
    state = np.array([40.0, y_m, -10.0, 0.0, 0.0, 0.0])
    box_px = np.array(box, dtype=np.float32)
    return Track(number, state, last_seen_s - followed_s, last_seen_s, box_px, 0)


@pytest.mark.parametrize("width", [1280, 640, 321])
def test_the_picture_has_the_width_asked_for(camera: Camera, picture: Image, width: int) -> None:
    """The height follows, and the frame itself is left as it was."""
    shown = annotate(picture, camera, [], {"approach": STATE}, 0.0, width)
    assert shown.shape == (round(720 * width / 1280), width, 3)
    assert shown.dtype == np.uint8
    assert (picture == 90).all()


def test_segments_and_vehicles_are_drawn_where_they_are(camera: Camera, picture: Image) -> None:
    """The segment is tinted, a box seen now outlined and labelled, one that coasts is not."""
    seen, lost = (900.0, 300.0, 1000.0, 380.0), (100.0, 300.0, 200.0, 380.0)
    shown = annotate(
        picture, camera, [track(1, seen, 5.0), track(2, lost, 4.0)], {"approach": STATE}, 5.0, 1280
    )
    u, v = project([[40.0, 3.0]])[0].round().astype(int)
    assert (shown[v, u] != 90).any()
    assert (shown[340, 900] > 200).all()
    assert (shown[285:298, 900:960] != 90).any()
    assert (shown[280:400, 90:210] == 90).all()


def test_speeds_are_shown_in_the_segments_only(camera: Camera, picture: Image) -> None:
    """Beside them the label is the number alone, and so a shorter one."""
    box = (900.0, 300.0, 1000.0, 380.0)
    inside, beside = (
        annotate(picture, camera, [track(1, box, 5.0, y_m)], {}, 5.0, 1280) for y_m in (3.0, -3.0)
    )
    changed = [(shown[270:298, 880:] != 90).any(axis=(0, 2)).sum() for shown in (inside, beside)]
    assert changed[0] > 2 * changed[1] > 0


def test_the_speed_of_a_vehicle_just_found_is_not_shown(camera: Camera, picture: Image) -> None:
    """A new track's speed says little for half a second."""
    box = (900.0, 300.0, 1000.0, 380.0)
    young, old = (
        annotate(picture, camera, [track(1, box, 5.0, followed_s=s)], {}, 5.0, 1280)
        for s in (0.4, 0.6)
    )
    changed = [(shown[270:298, 880:] != 90).any(axis=(0, 2)).sum() for shown in (young, old)]
    assert 0 < 2 * changed[0] < changed[1]


def test_labels_keep_out_of_each_others_way(picture: Image) -> None:
    """The second of two at one place takes its next place, the third has none."""
    labels = Labels(picture)
    places = [(100.0, 100.0), (100.0, 160.0)]
    assert [labels.put("#1 50 km/h", places, 1.0) for _ in range(3)] == [True, True, False]
    labels.draw()
    assert (picture[80:100, 100:200] != 90).any()
    assert (picture[140:160, 100:200] != 90).any()


def test_labels_stay_in_the_picture(picture: Image) -> None:
    """One that would hang over the right edge moves in; one above the top is left out."""
    labels = Labels(picture)
    assert labels.put("beyond the edge", [(1270.0, 100.0)], 1.0)
    assert not labels.put("too high", [(100.0, 5.0)], 1.0)


def test_each_flag_stands_beside_its_time(camera: Camera, picture: Image) -> None:
    """A picture that is looked at later does not say how the road is then."""
    shown = [
        annotate(picture, camera, [], {"approach": replace(STATE, **at)}, 0.0, 640)
        for at in ({"time_ns": 0}, {"time_ns": 0}, {"time_ns": 3_600_000_000_000})
    ]
    assert (shown[0] == shown[1]).all()
    assert (shown[0][:60] != shown[2][:60]).any()
    assert (shown[0][60:] == shown[2][60:]).all()


def test_moments_are_told_in_utc() -> None:
    """With its zone, whatever the machine's is."""
    assert utc_time(1_795_721_665_999_999_999) == "19:34:25 UTC"
    assert utc_date_and_time(1_795_721_665_999_999_999) == "2026-11-26 19:34:25 UTC"


@pytest.mark.parametrize("width", [1280, 640, 160])
def test_a_picture_shows_when_it_was_taken(picture: Image, width: int) -> None:
    """In its lower left corner, however small it is."""
    small = np.ascontiguousarray(picture[: width * 9 // 16, :width])
    draw_time(small, utc_date_and_time(0))
    rows = len(small)
    assert (small[3 * rows // 4 :, : width // 2] != 90).any()
    assert (small[: rows // 2] == 90).all()


@pytest.mark.parametrize("boxes", [True, False])
def test_a_past_picture_looks_like_one(camera: Camera, boxes: bool) -> None:
    """It has no colour and no flag."""
    green = np.full((720, 1280, 3), (40, 200, 90), dtype=np.uint8)
    shown = past_picture(green, camera, 0, 640, boxes=boxes).astype(int)
    assert shown.shape == (360, 640, 3)
    assert np.ptp(shown, axis=2).max() <= 20
    assert shown.max(axis=2)[100:250].mean() < 100

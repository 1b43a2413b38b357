"""Pictures that are worse than the view's own history, beside those that are merely poor."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from edge_daemon.settings import WatchSettings
from edge_daemon.watch import Watch
from slipstream.messages import CameraFault

from .roads import EVERY_S, Change, Picture, Road, at, shifted, warped

Boxes = npt.NDArray[np.float32]

GOOD = 40
NONE = np.zeros((0, 4), np.float32)
WIDTH_PX, HEIGHT_PX = 60.0, 45.0
PAINT = np.kron(
    np.random.default_rng(2).integers(0, 255, (3, 4, 3), np.uint8), np.ones((15, 15, 1), np.uint8)
)
"""What a vehicle of that size looks like."""


@pytest.fixture(autouse=True)
def every_frame_is_sampled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames are as far apart as samples, to the last bit or not."""
    monkeypatch.setattr("edge_daemon.watch.watch.SAMPLE_INTERVAL_S", 0.1)


def faults(
    road: Road, change: Change | None, boxes: Callable[[int], Boxes], count: int
) -> list[CameraFault | None]:
    """What the watch says of each sample; the change begins after `GOOD` of them."""
    watch = Watch(road.camera, WatchSettings())
    return [
        watch.look(at(n * EVERY_S, road.seen(n, change if n >= GOOD else None)), boxes(n))
        for n in range(count)
    ]


def box_at(road: Road, x_m: float, lane_m: float) -> list[float]:
    """A vehicle whose box's lower edge stands at a place on the road."""
    ((u, v),) = road.camera.to_image(np.array([[x_m, lane_m]]))
    return [u - WIDTH_PX / 2, v - HEIGHT_PX, u + WIDTH_PX / 2, v]


def trails(picture: Picture, time_s: float) -> Picture:
    """What vehicles leave behind in a decoder that has lost a packet: it grows, and stays."""
    chance = np.random.default_rng(1)
    picture = picture.copy()
    for _ in range(min(12, round((time_s - GOOD * EVERY_S) / EVERY_S) + 2)):
        left, top = int(chance.integers(500, 900)), int(chance.integers(330, 640))
        blocks = chance.integers(0, 255, (5, 12, 3), dtype=np.uint8)
        picture[top : top + 40, left : left + 96] = np.repeat(np.repeat(blocks, 8, 0), 8, 1)
    return picture


def jpeg(quality: int) -> Change:
    """Through an encoder."""

    def change(picture: Picture, _: float) -> Picture:
        coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), dtype=np.uint8)

    return change


def rain(picture: Picture, time_s: float) -> Picture:
    """Nine hundred streaks and noise, others in each picture."""
    chance = np.random.default_rng(round(time_s / EVERY_S))
    streaks = np.zeros(picture.shape[:2], np.uint8)
    for left, top in chance.integers((0, 0), (1280, 720), (900, 2)).tolist():
        cv2.line(streaks, (left, top), (left - 6, top + 24), 120, 1)
    grain = chance.normal(0, 5, picture.shape[:2])
    wet = 0.9 * picture.astype(np.float32) + (0.5 * streaks + grain)[..., None] + 10
    return np.clip(wet, 0, 255).astype(np.uint8)


def blurred(sigma_px: float) -> Change:
    """Out of focus."""
    return lambda picture, _: np.asarray(
        cv2.GaussianBlur(picture, (0, 0), sigma_px), dtype=np.uint8
    )


def rolled(degrees: float) -> Change:
    """The camera has turned about its optical axis."""
    return warped(cv2.getRotationMatrix2D((640, 360), degrees, 1.0))


def shaking(pixels: float) -> Change:
    """The mast swings in the wind, at two frequencies a direction."""

    def change(picture: Picture, time_s: float) -> Picture:
        right = np.sin(10.7 * time_s) + 0.7 * np.sin(20.3 * time_s + 1)
        down = np.sin(11.7 * time_s + 2) + 0.7 * np.sin(24.6 * time_s + 4)
        return warped([[1, 0, pixels * right], [0, 1, pixels * down]])(picture, time_s)

    return change


@pytest.mark.parametrize(
    ("change", "expected", "within_s"),
    [
        (trails, "corrupt", 5.0),
        (blurred(3.0), "obscured", 3.0),
        (rolled(0.5), "camera_moved", 6.0),
        pytest.param(shaking(5.0), "camera_moved", 6.0, marks=pytest.mark.long),
        pytest.param(shifted(40.0), "camera_moved", 6.0, marks=pytest.mark.long),
    ],
    ids=["trails", "out of focus", "rolled", "shaking", "turned"],
)
def test_what_spoils_tracks_is_told(
    road: Road, change: Change, expected: CameraFault, within_s: float
) -> None:
    """Each by its name; nothing before it begins."""
    said = faults(road, change, lambda _: NONE, GOOD + round(within_s / EVERY_S) + 1)
    assert set(said[:GOOD]) == {None}
    assert said[-1] == expected
    assert set(said) == {None, expected}


@pytest.mark.long
@pytest.mark.parametrize(
    "change",
    [jpeg(20), rain, blurred(1.5), rolled(0.15), shaking(1.0)],
    ids=["JPEG quality 20", "rain", "a little soft", "rolled a little", "trembling"],
)
def test_a_poor_picture_is_no_fault(road: Road, change: Change) -> None:
    """The detector copes with these."""
    assert set(faults(road, change, lambda _: NONE, GOOD + 40)) == {None}


@pytest.mark.long
def test_vehicles_that_are_detected_are_no_trails(road: Road) -> None:
    """The same patches, each with a box around it: traffic that stands."""
    chance = np.random.default_rng(1)
    boxes = []
    for _ in range(12):
        left, top = int(chance.integers(500, 900)), int(chance.integers(330, 640))
        chance.integers(0, 255, (5, 12, 3), dtype=np.uint8)
        boxes.append([left, top, left + 96, top + 40])
    all_boxes = np.array(boxes, np.float32)
    assert set(faults(road, trails, lambda _: all_boxes, GOOD + 40)) == {None}


@pytest.mark.long
def test_trails_that_stay_become_the_road(road: Road) -> None:
    """After two minutes: what lies on the road for so long is no fault of the camera."""

    def lying(picture: Picture, _: float) -> Picture:
        return trails(picture, 1e6)

    said = faults(road, lying, lambda _: NONE, GOOD + round(150 / EVERY_S))
    assert "corrupt" in said
    assert said[-1] is None


def parked(road: Road, count: int) -> tuple[Change, Boxes]:
    """Vehicles of ten thousand pixels that stand, as they look, and their boxes."""
    places = [(540, 560), (700, 420), (560, 340), (860, 600), (640, 640)][:count]
    chance = np.random.default_rng(2)
    paint = np.repeat(np.repeat(chance.integers(0, 255, (10, 12, 3), np.uint8), 8, 0), 10, 1)

    def change(picture: Picture, _: float) -> Picture:
        picture = picture.copy()
        for left, top in places:
            picture[top : top + 80, left : left + 120] = paint
        return picture

    return change, np.array([[u, v, u + 120, v + 80] for u, v in places], np.float32)


@pytest.mark.long
def test_a_queue_that_drives_off_leaves_no_trails(road: Road) -> None:
    """It stood when the view was learned: the road that it bares was never seen."""
    change, boxes = parked(road, 5)
    watch = Watch(road.camera, WatchSettings())
    said = [
        watch.look(at(n * EVERY_S, road.seen(n, change if n < GOOD else None)), here)
        for n in range(GOOD + 60)
        for here in [boxes if n < GOOD else NONE]
    ]
    assert set(said) == {None}


@pytest.mark.long
def test_a_long_stand_does_not_become_road(road: Road) -> None:
    """The road was known, then a queue stood for three minutes, and drives off."""
    change, boxes = parked(road, 5)
    watch = Watch(road.camera, WatchSettings())
    pictures = {
        queue: [road.seen(n, change if queue else None) for n in range(3)]
        for queue in (True, False)
    }
    said = set()
    for n in range(GOOD + 900 + 60):
        stands = GOOD <= n < GOOD + 900
        image = pictures[stands][n % 3]
        said.add(watch.look(at(n * EVERY_S, image), boxes if stands else NONE))
    assert "corrupt" not in said


@pytest.mark.long
def test_a_vehicle_that_is_not_detected_is_no_trail(road: Road) -> None:
    """Two that stand near the camera, or five with a low score: more than a fiftieth of it."""
    change, boxes = parked(road, 2)
    assert set(faults(road, change, lambda _: NONE, GOOD + 40)) == {None}
    change, boxes = parked(road, 5)
    watch = Watch(road.camera, WatchSettings())
    said = [
        watch.look(at(n * EVERY_S, road.seen(n, change if n >= GOOD else None)), NONE, boxes)
        for n in range(GOOD + 40)
    ]
    assert set(said) == {None}


def driving(road: Road, speed_mps: Callable[[float], float]) -> Callable[[int], Boxes]:
    """Three vehicles, 20 m apart, in the near part of the road; new ones follow the last."""
    way = [0.0]
    for n in range(1000):
        way.append(way[-1] + EVERY_S * speed_mps(n * EVERY_S))

    def boxes(n: int) -> Boxes:
        places = [20.0 + (way[n] + 20.0 * k) % 60.0 for k in range(3)]
        return np.array([box_at(road, x_m, 4.0) for x_m in places], np.float32)

    return boxes


@pytest.mark.long
def test_a_repeated_picture_with_fresh_noise_is_frozen(road: Road) -> None:
    """Its vehicles tell: all of them stop at once, which no brake can do."""
    stop_s = GOOD * EVERY_S
    boxes = driving(road, lambda time_s: 15.0 if time_s < stop_s else 0.0)
    said = faults(road, None, boxes, GOOD + 40)
    assert "frozen" not in said[: GOOD + 20]
    assert set(said[GOOD + 30 :]) == {"frozen"}


@pytest.mark.long
def test_a_frozen_picture_that_moves_again_is_none(road: Road) -> None:
    """The fault ends `clear_after_s` later."""
    begin_s, end_s = GOOD * EVERY_S, GOOD * EVERY_S + 8.0
    boxes = driving(road, lambda time_s: 0.0 if begin_s <= time_s < end_s else 15.0)
    said = faults(road, None, boxes, GOOD + 70)
    assert "frozen" in said
    assert said[-1] is None


@pytest.mark.long
def test_vehicles_in_a_frozen_picture_become_neither_trails_nor_road(road: Road) -> None:
    """The detector misses them in the very picture that freezes, after 8 s of learning. When it
    moves again the fault ends within 2.2 s, and none is left behind.
    """
    begin, end = GOOD, GOOD + 50
    boxes = driving(road, lambda _: 15.0)

    def traffic(picture: Picture, time_s: float) -> Picture:
        picture = picture.copy()
        for left, top, right, bottom in boxes(round(time_s / EVERY_S)).astype(int).tolist():
            picture[top:bottom, left:right] = PAINT
        return picture

    watch = Watch(road.camera, WatchSettings())
    still, said = road.seen(begin, traffic), []
    for n in range(end + 75):
        freezes = begin <= n < end
        picture = still if freezes else road.seen(n, traffic)
        said.append(watch.look(at(n * EVERY_S, picture), NONE if freezes else boxes(n)))
    assert set(said[:begin]) == {None}
    assert set(said[begin:end]) == {None, "frozen"}
    assert set(said[end + round(2.2 / EVERY_S) :]) == {None}


@pytest.mark.long
def test_traffic_that_brakes_or_leaves_is_not_frozen(road: Road) -> None:
    """An emergency stop at 9 m/s² by all, and a queue that the last moving ones drive away from."""
    stop_s = GOOD * EVERY_S
    braking = driving(road, lambda time_s: max(0.0, 15.0 - 9.0 * max(0.0, time_s - stop_s)))
    assert "frozen" not in faults(road, None, braking, GOOD + 50)

    moving = driving(road, lambda _: 15.0)
    queue = np.array([box_at(road, 24.0 + 7 * k, 0.5) for k in range(8)], np.float32)

    def leaving(n: int) -> Boxes:
        return np.concatenate([queue, moving(n)]) if n < GOOD else queue

    assert "frozen" not in faults(road, None, leaving, GOOD + 50)


@pytest.mark.long
def test_boxes_that_flicker_in_a_queue_are_not_frozen(road: Road) -> None:
    """Two of eight are hidden for a moment, then found again: nothing moved."""
    queue = np.array([box_at(road, 24.0 + 7 * k, 0.5) for k in range(8)], np.float32)

    def boxes(n: int) -> Boxes:
        return np.delete(queue, [3, 4], axis=0) if GOOD <= n < GOOD + 3 else queue

    assert "frozen" not in faults(road, None, boxes, GOOD + 50)

"""How much of what moves in a recording a detector finds, and how often it finds what is not there:
a model's trial before anybody trusts it.

The measurement is that of the fault `blind`: a background model tells what moves, five times a
second; what lies in boxes that could start a track is covered. It knows nothing of what stands, and
takes shadows, trees and people that move for vehicles where no calibration tells their place.

A box is false where nothing moves and where, while nothing moves there, it comes and goes: a
vehicle that stands is found again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from edge_daemon.camera import Array, Camera
from edge_daemon.detection import (
    VEHICLE_CLASSES,
    Detections,
    box_feet,
    detect_stream,
    open_detector,
)
from edge_daemon.frame import Frame
from edge_daemon.settings import DetectorSettings
from edge_daemon.sources.clip import FastClip, open_clip
from edge_daemon.tracking import HIGH_SCORE
from edge_daemon.watch.background import Background
from edge_daemon.watch.faults.blind import MISSED_TO_FOUND
from edge_daemon.watch.motion import MotionFinder, covered, covering
from edge_daemon.watch.sample import Mask, road_mask, small_grey
from edge_daemon.watch.watch import SAMPLE_INTERVAL_S

MIN_COVERED: Final = 0.8
MAX_FALSE: Final = 0.01
"""Share of false boxes, of these and the covered things."""
MIN_THINGS: Final = 50
BANDS: Final = ("near", "middle", "far")
_HEIGHTS: Final = (1 / 12, 1 / 24)
"""Of things, as shares of the picture's height: where they are, roughly, without a calibration."""
_PARTS: Final = len(BANDS)
_AROUND: Final = 50
"""Pictures before and after one, 10 s each, in which its boxes are looked for again."""
_SAME_IOU: Final = 0.4
_STEADY: Final = 0.5
"""Share of these pictures in which a vehicle that stands is found."""
_STILL: Final = 0.05
"""Share of a box that may differ from the background where nothing moves."""


@dataclass(frozen=True)
class Band:
    """Things at one distance.

    Attributes:
        name: one of BANDS.
        begin, end: the distances, of the unit of the whole; end is None for the last one.
        things: moving things seen, one in several pictures counted in each.
        covered: of them, in boxes that could start a track.
        covered_at_all: of them, in boxes of any score that the detector gives.
    """

    name: str
    begin: float
    end: float | None
    things: int
    covered: int
    covered_at_all: int


@dataclass(frozen=True)
class Coverage:
    """What a detector finds of what moves.

    Attributes:
        pictures: that were compared.
        unit: of the bands: metres along the road from its nearest watched place; or px of height.
        bands: near, middle and far.
        classes: of the boxes that cover a thing best, by name of VEHICLE_CLASSES.
        false: boxes that come and go where nothing moves, with a calibration those on the road.
        verdict: usable from MIN_COVERED on and up to MAX_FALSE; blind where the daemon would say
            so; unsure with too few things to tell.
    """

    pictures: int
    unit: Literal["m", "px"]
    bands: tuple[Band, ...]
    classes: dict[str, int]
    false: int
    verdict: Literal["usable", "doubtful", "blind", "unsure"]

    @property
    def things(self) -> int:
        """Of all bands."""
        return sum(band.things for band in self.bands)

    @property
    def share(self) -> float:
        """Covered things over things; 0 where nothing moved."""
        return sum(band.covered for band in self.bands) / max(1, self.things)

    @property
    def false_share(self) -> float:
        """False boxes over these and the covered things; 0 without either."""
        return _false_share(self.bands, self.false)


def measure_coverage(
    clip: Path,
    settings: DetectorSettings,
    camera: Camera | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    fps: float | None = None,
) -> Coverage:
    """Hold a detector against what moves in a clip.

    Args:
        clip: a video file; the background is learned from its first four seconds.
        settings: the model.
        camera: the clip's calibration: only what moves on watched road counts.
        progress: called with the numbers of processed and of expected pictures.
        fps: frames a second that the clip was filmed at; None: as it says.

    Raises:
        InputError: the clip or the model cannot be used, or the clip does not fit the camera.
    """
    reader = open_clip(clip, loop=False, size=None if camera is None else camera.size, fps=fps)
    detector = open_detector(settings, camera)
    expected = reader.expected_frames
    pictures = 0
    background: Background | None = None
    things, sure, any_score = [], [], []
    classes = dict.fromkeys(VEHICLE_CLASSES, 0)
    height = 0
    frames = _sampled(FastClip(reader).frames(), lambda done: progress(done, expected))
    with closing(detect_stream(frames, detector)) as results:
        for frame, found in results:
            if frame is None or found is None:
                continue
            small = small_grey(frame.image)
            if background is None:
                height = frame.image.shape[0]
                road = np.ones(small.shape, dtype=np.bool_)
                if camera is not None:
                    road = road_mask(camera, (small.shape[0], small.shape[1]), 0.0)
                zoom = small.shape[1] / frame.image.shape[1]
                background = Background()
                motion = MotionFinder(background, road, zoom, camera)
                false = _FalseBoxes(zoom, camera)
            background.update(small)
            moving = motion.find()
            if moving is None or background.foreground is None or background.changed is None:
                continue
            pictures += 1
            tracked = _above(found, HIGH_SCORE)
            # A dark car may be as a shadow is, but it moves.
            differs = background.foreground | background.changed
            false.add(differs, tracked.boxes.astype(np.float64))
            has_box = covered(moving, tracked.boxes.astype(np.float64))
            things.append(moving)
            sure.append(has_box)
            any_score.append(covered(moving, found.boxes.astype(np.float64)))
            if has_box.any():
                best = covering(moving[has_box], tracked.boxes.astype(np.float64)).argmax(axis=1)
                for index in tracked.classes[best]:
                    classes[VEHICLE_CLASSES[index]] += 1
    if not things:
        things, sure, any_score = [np.empty((0, 4))], [np.empty(0, bool)], [np.empty(0, bool)]
    bands = _bands(
        np.concatenate(things), np.concatenate(sure), np.concatenate(any_score), camera, height
    )
    number = 0 if background is None else false.end()
    unit: Literal["m", "px"] = "px" if camera is None else "m"
    return Coverage(pictures, unit, bands, classes, number, _verdict(bands, number))


def _sampled(frames: Iterable[Frame], note: Callable[[int], None]) -> Iterator[Frame]:
    """Frames as far apart as the watch takes them."""
    due_s = 0.0
    for number, frame in enumerate(frames):
        if frame.media_time_s >= due_s:
            due_s = frame.media_time_s + SAMPLE_INTERVAL_S
            yield frame
        note(number + 1)


def _above(found: Detections, score: float) -> Detections:
    keep = found.scores >= score
    return Detections(found.boxes[keep], found.scores[keep], found.classes[keep])


def _bands(
    things: Array, sure: Array, any_score: Array, camera: Camera | None, height: int
) -> tuple[Band, ...]:
    """Near, middle, far: thirds of the watched road's length, or by height in the picture."""
    if camera is None:
        limits = [share * height for share in _HEIGHTS]
        place = np.digitize(-(things[:, 3] - things[:, 1]), [-limit for limit in limits])
        ends: list[tuple[float, float | None]] = [
            (limits[0], None),
            (limits[1], limits[0]),
            (0.0, limits[1]),
        ]
    else:
        outline = np.concatenate([segment.polygon_m for segment in camera.segments])
        nearest = outline[np.nanargmax(camera.to_image(outline)[:, 1])]
        length = float(np.linalg.norm(outline - nearest, axis=1).max())
        limits = [length * part / _PARTS for part in range(1, _PARTS)]
        distance = np.linalg.norm(camera.to_road(box_feet(things)) - nearest, axis=1)
        place = np.digitize(distance, limits)
        ends = [(0.0, limits[0]), (limits[0], limits[1]), (limits[1], None)]
    return tuple(
        Band(
            name,
            round(begin, 1),
            None if end is None else round(end, 1),
            int(np.count_nonzero(place == index)),
            int(np.count_nonzero(sure[place == index])),
            int(np.count_nonzero(any_score[place == index])),
        )
        for index, (name, (begin, end)) in enumerate(zip(BANDS, ends, strict=True))
    )


class _FalseBoxes:
    """Counts boxes that come and go where nothing moves, with a calibration those on the road."""

    def __init__(self, zoom: float, camera: Camera | None) -> None:
        self.count = 0
        self._zoom, self._camera = zoom, camera
        self._around: deque[tuple[Mask, Array]] = deque(maxlen=2 * _AROUND + 1)
        self._added = self._judged = 0

    def add(self, moving: Mask, boxes: Array) -> None:
        """The next picture: what moves in the small one, and the boxes (n, 4) of the frame."""
        self._around.append((moving, boxes * self._zoom))
        self._added += 1
        if self._added - self._judged > _AROUND:
            self._judge_next()

    def end(self) -> int:
        """No picture comes any more; the count."""
        while self._judged < self._added:
            self._judge_next()
        return self.count

    def _judge_next(self) -> None:
        """The pictures before and after are there."""
        moving = np.stack([each for each, _ in self._around])
        at = self._judged - (self._added - len(self._around))
        self._judged += 1
        for box in self._on_road(self._around[at][1]):
            left, top = (max(0, round(corner)) for corner in box[:2])
            right, bottom = (round(corner) + 1 for corner in box[2:])
            still = moving[:, top:bottom, left:right].mean(axis=(1, 2)) < _STILL
            if still[at]:
                found = [_is_among(box, boxes) for _, boxes in self._around]
                self.count += int((still & found).sum() < _STEADY * still.sum())

    def _on_road(self, boxes: Array) -> Array:
        if self._camera is None:
            return boxes
        feet = self._camera.to_road(box_feet(boxes / self._zoom))
        within = [segment.contains(feet) for segment in self._camera.segments]
        return np.asarray(boxes[np.any(within, axis=0)])


def _is_among(box: Array, boxes: Array) -> bool:
    """Whether one of the boxes (n, 4) is nearly the same as one (4,)."""
    low, high = np.maximum(boxes[:, :2], box[:2]), np.minimum(boxes[:, 2:], box[2:])
    both = np.prod(np.clip(high - low, 0.0, None), axis=1)
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) + np.prod(box[2:] - box[:2])
    return bool((both > _SAME_IOU * (areas - both)).any())


def _false_share(bands: Sequence[Band], false: int) -> float:
    return false / max(1, false + sum(band.covered for band in bands))


def _verdict(
    bands: tuple[Band, ...], false: int
) -> Literal["usable", "doubtful", "blind", "unsure"]:
    things = sum(band.things for band in bands)
    found = sum(band.covered for band in bands)
    if things < MIN_THINGS:
        return "unsure"
    if things - found > MISSED_TO_FOUND * found:
        return "blind"
    good = found >= MIN_COVERED * things and _false_share(bands, false) <= MAX_FALSE
    return "usable" if good else "doubtful"

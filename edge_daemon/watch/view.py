"""Where the view of a frame lies against the calibrated one: shifted and turned about its middle.

Points with texture beside the road are followed by the method of Lucas and Kanade, and one rigid
motion is fitted to what most of them say. The calibrated view is held against each frame first;
where light or season no longer let it be recognised, the view of some minutes ago, whose own motion
was measured, is used instead.
"""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array, Camera, polygon_mask
from edge_daemon.frame import Image
from edge_daemon.watch.sample import Floats, Grey, Mask, detail_grey, road_mask

log = logging.getLogger(__name__)

LOST_SHARE: Final = 0.7
"""So much of the points not found, and the view is another one."""
_RECOGNISED_SHARE: Final = 0.5
_FOUND_AGAIN_SHARE: Final = 0.7
_LEARN_S: Final = 4.0
_LEARN_FRAMES: Final = 9
_RECENT_S: Final = 300.0
_VEHICLE_MARGIN: Final = 0.06
_MAX_POINTS: Final = 40
_MIN_POINTS: Final = 6
_APART_PX: Final = 24
_EDGE_PX: Final = 24
_CORNER_PX: Final = 15
_MIN_CORNER: Final = 3000.0
"""Of the sum of squared gradients in a window; noise of 4 levels has 1,800."""
_WINDOW_PX: Final = 21
_LEVELS: Final = 3
_BLUR_PX: Final = 15
_USUAL_LEVELS: Final = 10.0
_MAX_GAIN: Final = 4.0
_AGREES_PX: Final = 0.5
_ROUNDS: Final = 5
_MIN_SPREAD: Final = 0.2
"""Points closer together than this, as a share of the road's size, do not tell a turn."""
_NOISE_PX: Final = 0.05
_MEMORY: Final = 0.05


@dataclass(frozen=True)
class ViewMotion:
    """Shift (right, down), px, and turn, rad, about the picture's middle, of what a frame shows
    against the calibrated view.
    """

    shift: Array
    turn: float
    middle: Array

    def at(self, points: Array) -> Array:
        """How far points (n, 2) of the picture, px, are displaced, px, shape (n, 2)."""
        off = points - self.middle
        return np.asarray(self.shift + self.turn * off[:, ::-1] * (-1.0, 1.0))


@dataclass
class _Landmarks:
    """Points of one view: the picture to find them in, their places, shape (n, 2), its motion
    (right, down, turn), and the mean square of what each is off by, shape (n,).
    """

    picture: Grey
    places: npt.NDArray[np.float32]
    motion: Array
    error_px2: Array = field(init=False)

    def __post_init__(self) -> None:
        self.error_px2 = np.full(len(self.places), _NOISE_PX**2)


class View:
    """Measures the motion of one camera's view, frame by frame.

    Attributes:
        motion: of the last frame; None where too few points were found, or none is known yet.
        found_share: of the points, those that agreed in it.
        is_recent: whether it was held against a view that is not the calibrated one.
        calibrated: the detailed grey picture of the calibrated view; None: not known yet.
    """

    def __init__(self, camera: Camera, reference: Image | None) -> None:
        width, height = camera.size
        blank = detail_grey(np.zeros((height, width, 3), np.uint8))
        self._zoom = blank.shape[1] / width
        self._middle = np.array([width, height]) / 2
        self._road = road_mask(camera, blank.shape, _VEHICLE_MARGIN)
        # The outline of what is hidden stays where it is in any picture.
        hidden = polygon_mask([mask * self._zoom for mask in camera.masks], blank.shape, _EDGE_PX)
        self._shown = ~hidden
        self._hull = _hull(self._road)
        self._span = float(np.ptp(self._hull, axis=0).max())
        self.calibrated: Grey | None = None
        self.motion: ViewMotion | None = None
        self.found_share = 0.0
        self.is_recent = False
        self._raw = self._home = np.zeros(3)
        self._early: list[Array] = []
        self._first: _Landmarks | None = None
        self._recent: _Landmarks | None = None
        self._recent_s = 0.0
        self._learning: deque[tuple[float, Grey]] = deque()
        if reference is not None:
            self.calibrated = detail_grey(reference)
            self._first = self._choose(self.calibrated, np.zeros(3))

    @property
    def is_bare(self) -> bool:
        """Whether the calibrated view has nothing to recognise."""
        return self._first is not None and len(self._first.places) < _MIN_POINTS

    def measure(self, detail: Grey) -> None:
        """Find the motion of a frame, given its `detail_grey` copy."""
        self.motion, self.found_share = None, 0.0
        if self._first is None:
            return
        picture = _even(detail)
        # Two limits, so that the views do not take turns.
        enough = _FOUND_AGAIN_SHARE if self.is_recent else _RECOGNISED_SHARE
        motion, share = self._fit(self._first, picture)
        self.is_recent = False
        if self._recent is not None and share < enough:
            later, later_share = self._fit(self._recent, picture)
            if later_share > share or share < _RECOGNISED_SHARE:
                motion, share, self.is_recent = later, later_share, True
        self.found_share = share
        if motion is not None and share >= 1 - LOST_SHARE:
            self._raw = motion
            if self.calibrated is None:
                # The first frame is as likely off as any other.
                self._early.append(motion)
                self._home = np.median(self._early, axis=0)
            still = motion - self._home
            self.motion = ViewMotion(still[:2] / self._zoom, float(still[2]), self._middle)

    def learn(self, time_s: float, detail: Grey) -> None:
        """Take in a frame of a scene that can be seen: the first seconds are the calibrated view
        where no other is known, and what is recognised after minutes is the recent one.
        """
        if self._first is None:
            self._first = self._choose(detail, np.zeros(3))
            self.measure(detail)
        if self.calibrated is None:
            self._learning.append((time_s, detail))
            if time_s - self._learning[0][0] >= _LEARN_S and len(self._learning) >= _MIN_POINTS:
                self._begin(time_s, detail)
        elif (
            time_s - self._recent_s > _RECENT_S
            and self.motion is not None
            and self.found_share >= _RECOGNISED_SHARE
        ):
            recent = self._choose(detail, self._raw)
            if len(recent.places) >= _MIN_POINTS:
                self._recent, self._recent_s = recent, time_s

    def restart(self) -> None:
        """Drop what was learned of a view that is not known yet: the scene was cut."""
        self._learning.clear()
        self._early.clear()
        if self.calibrated is None:
            self._first = self.motion = None

    def _begin(self, time_s: float, detail: Grey) -> None:
        chosen = np.linspace(0, len(self._learning) - 1, _LEARN_FRAMES).astype(int)
        pictures = np.stack([self._learning[i][1] for i in sorted(set(chosen))])
        # The median removes vehicles that pass through.
        self.calibrated = np.median(pictures, axis=0).astype(np.uint8)
        self._learning.clear()
        self._early.clear()
        self._recent_s = time_s
        median = self._choose(self.calibrated, np.zeros(3))
        found, share = self._fit(median, _even(detail))
        if self.motion is not None and found is not None and share >= _RECOGNISED_SHARE:
            # Places of vehicles go on without a step.
            median.motion = self._raw - found
        self._first = median
        self.measure(detail)

    def displacement(self) -> Array | None:
        """How far corners of the watched road lie from where they are in the calibrated view, px,
        shape (n, 2); None where `motion` is.
        """
        if self.motion is None:
            return None
        return self.motion.at(self._hull / self._zoom)

    def _choose(self, detail: Grey, motion: Array) -> _Landmarks:
        places = _corners(detail, self._shown & ~self._road)
        if len(places) < _MIN_POINTS:
            # A frame full of road: its markings must do.
            places = _corners(detail, self._shown)
        if not len(places) and self._first is None:
            log.warning("the view has nothing to recognise: a moved camera would go unnoticed")
        return _Landmarks(_even(detail), places, motion)

    def _fit(self, marks: _Landmarks, picture: Grey) -> tuple[Array | None, float]:
        """The motion (right, down, turn) against the calibrated view, px of the detailed picture,
        and which share of the points agrees with it.
        """
        if len(marks.places) < _MIN_POINTS:
            return None, 0.0
        places, status, _ = cv2.calcOpticalFlowPyrLK(
            marks.picture,
            picture,
            marks.places,
            marks.places.copy(),
            winSize=(_WINDOW_PX, _WINDOW_PX),
            maxLevel=_LEVELS,
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.01),
        )
        moved = np.asarray(places - marks.places, dtype=np.float64)
        seen = np.asarray(status).ravel() > 0
        off = marks.places - self._middle * self._zoom
        design = np.zeros((len(off), 2, 3))
        design[:, 0, 0] = design[:, 1, 1] = 1.0
        design[:, 0, 2], design[:, 1, 2] = -off[:, 1], off[:, 0]
        columns = 3 if float(off.std(axis=0).max()) > _MIN_SPREAD * self._span else 2
        motion = np.zeros(3)
        if not seen.any():
            return None, 0.0
        motion[:2] = np.median(moved[seen], axis=0)
        certain = seen / (marks.error_px2 + _NOISE_PX**2)
        for _ in range(_ROUNDS):
            left = np.sum((moved - design @ motion) ** 2, axis=1)
            weight = certain / (1 + left / _AGREES_PX**2) ** 2
            used = design[:, :, :columns]
            normal = np.einsum("n,nik,nil->kl", weight, used, used)
            right = np.einsum("n,nik,ni->k", weight, used, moved)
            motion[:columns] = np.linalg.solve(normal + 1e-9 * np.eye(columns), right)
        left = np.sum((moved - design @ motion) ** 2, axis=1)
        share = float(np.mean(seen & (left < _AGREES_PX**2)))
        if share >= _RECOGNISED_SHARE:
            # What sways by itself, or is covered now and then, counts for less.
            left = np.where(seen, np.minimum(left, 1.0), 1.0)
            marks.error_px2 += _MEMORY * (left - marks.error_px2)
        return motion + marks.motion, share


def _even(detail: Grey) -> Grey:
    """What differs from its surroundings, around 128, its contrast the same in any light."""
    blurred = cv2.blur(detail, (_BLUR_PX, _BLUR_PX))
    usual = float(cv2.absdiff(detail, blurred).mean())
    gain = min(_USUAL_LEVELS / max(usual, 1e-3), _MAX_GAIN)
    return np.asarray(cv2.addWeighted(detail, gain, blurred, -gain, 128), dtype=np.uint8)


def _corners(detail: Grey, allowed: Mask) -> npt.NDArray[np.float32]:
    """Places (n, 2) with corners in them, far apart, whose centres are allowed."""
    levels: Floats = detail.astype(np.float32)
    levels -= cv2.blur(levels, (_BLUR_PX, _BLUR_PX))
    strength = cv2.cornerMinEigenVal(levels, _CORNER_PX) * _CORNER_PX**2
    inside = np.zeros_like(allowed)
    inside[_EDGE_PX:-_EDGE_PX, _EDGE_PX:-_EDGE_PX] = True
    strength[~(allowed & inside)] = 0.0
    places: list[tuple[int, int]] = []
    while len(places) < _MAX_POINTS:
        _, best, _, place = cv2.minMaxLoc(strength)
        if best < _MIN_CORNER:
            break
        cv2.circle(strength, place, _APART_PX, (0.0,), cv2.FILLED)
        places.append((int(place[0]), int(place[1])))
    return np.array(places, dtype=np.float32).reshape(-1, 2)


def _hull(road: Mask) -> Array:
    """Corners of the convex hull of the road, or of all of the image if it has none, (n, 2) px."""
    rows, columns = np.nonzero(road if road.any() else np.ones_like(road))
    hull = cv2.convexHull(np.column_stack([columns, rows]).astype(np.int32))
    return np.asarray(hull, dtype=np.float64).reshape(-1, 2)

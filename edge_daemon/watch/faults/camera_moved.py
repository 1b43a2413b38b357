"""`camera_moved`: the view has shifted or turned against the calibrated one, or shakes.

Tiles beside the road are located in each examined frame. Their shifts give that of the road by a
similarity transform, for a roll about the optical axis moves the middle of the picture little and
its corners much. The calibrated view is compared first; where light or season no longer let it be
recognised, the view of some minutes ago, whose own shift was measured, is used instead.
"""

from __future__ import annotations

import logging
from collections import deque
from typing import ClassVar, Final

import cv2
import numpy as np

from edge_daemon.camera import Array
from edge_daemon.watch.judge import FaultJudge
from edge_daemon.watch.sample import Floats, Grey, Mask, Sample, sharpness, texture
from edge_daemon.watch.tiles import Tiles, choose_tiles
from slipstream.messages import CameraFault

log = logging.getLogger(__name__)

_LEARN_S: Final = 4.0
_LEARN_FRAMES: Final = 9
_MIN_TILES: Final = 6
SHARE: Final = 0.5
_LOST_SHARE: Final = 0.7
_RECENT_S: Final = 300.0
_FOUND_AGAIN_SHARE: Final = 0.3
_MIN_FITTED: Final = 6
_MIN_SPREAD: Final = 0.2
"""Tiles closer together than this, as a share of the road's size, do not tell a turn from noise."""
_SHAKE_TO_SHIFT: Final = 1.5
"""Shaking is averaged out by the tracker, a shift is not: it may be larger."""


class CameraMovedJudge(FaultJudge):
    """Looks for a view that has shifted. `sharpness` is that of the calibrated view; None while
    that is not known.
    """

    fault: ClassVar[CameraFault] = "camera_moved"

    def __init__(self, view: ViewShift) -> None:
        self._view = view
        self._moved = False
        self.sharpness = view.reference_sharpness

    def look(self, sample: Sample) -> bool:
        """True if the view had shifted when it was last examined."""
        if sample.shows_view:
            was_learned = self._view.is_learned
            self._moved = self._view.is_shifted(sample.time_s, sample.small, sample.texture)
            if self._view.is_learned and not was_learned:
                self.sharpness = sharpness(sample.small, sample.texture)
        return self._moved

    def interrupt(self, by: CameraFault | None) -> None:
        """Shifts are measured across other faults that hide the scene for a moment."""
        if by in (None, "obscured"):
            self._view.restart()


class ViewShift:
    """Measures the shift of a camera's view against the calibrated one.

    Args:
        max_share: allowed shift, as a share of the frame's width.
        median_s: time over which the median of the shifts is taken.
        road: where vehicles drive in the small grey image.
        reference: small grey image of the calibrated view; None: learned from the first seconds.
    """

    def __init__(
        self, max_share: float, median_s: float, road: Mask, reference: Grey | None
    ) -> None:
        self._max_px = max_share * road.shape[1]
        self._median_s = median_s
        self._road = road
        self._learning: deque[tuple[float, Grey]] = deque()
        self._calibrated: Tiles | None = None
        self.reference_sharpness: float | None = None
        if reference is not None:
            reference_texture = texture(reference)
            self._calibrated = self._choose(reference_texture)
            self.reference_sharpness = sharpness(reference, reference_texture)
        self._recent: Tiles | None = None
        self._recent_s = 0.0
        self._recent_shift = np.zeros(2)
        self._shifts: deque[tuple[float, Tiles, Array]] = deque()
        self._moved = False
        self._corners = _hull(road)

    @property
    def is_learned(self) -> bool:
        """Whether the calibrated view is known yet."""
        return self._calibrated is not None

    def is_shifted(self, time_s: float, small: Grey, view: Floats) -> bool:
        """Whether the camera shows another view than when it was calibrated, by the small grey
        image of a scene that can be seen, and its `texture`.
        """
        if self._calibrated is None:
            self._learn(time_s, small)
            return False
        tiles, shifts = self._measure(view)
        if self._shifts and self._shifts[-1][1] is not tiles:
            self._shifts.clear()
        self._shifts.append((time_s, tiles, shifts))
        while time_s - self._shifts[0][0] > self._median_s:
            self._shifts.popleft()
        if time_s - self._shifts[0][0] < 0.7 * self._median_s:
            return self._moved
        self._moved = moved = self._judge()
        if not moved and time_s - self._recent_s > _RECENT_S:
            self._renew(time_s, view, shifts)
        return moved

    def restart(self) -> None:
        """Drop the shifts measured so far, but not the calibrated view."""
        self._shifts.clear()
        self._moved = False
        self._learning.clear()

    def _choose(self, view: Floats) -> Tiles:
        tiles = choose_tiles(view, ~self._road)
        if len(tiles) < _MIN_TILES:
            # A frame full of road: its markings must do.
            tiles = choose_tiles(view, np.ones_like(self._road))
        if not len(tiles) and self._calibrated is None:
            log.warning("the view has nothing to recognise: a moved camera would go unnoticed")
        return tiles

    def _learn(self, time_s: float, small: Grey) -> None:
        self._learning.append((time_s, small))
        if time_s - self._learning[0][0] < _LEARN_S or len(self._learning) < _MIN_TILES:
            return
        chosen = np.linspace(0, len(self._learning) - 1, _LEARN_FRAMES).astype(int)
        images = np.stack([self._learning[i][1] for i in sorted(set(chosen))])
        # The median removes vehicles that pass through.
        self._calibrated = self._choose(texture(np.median(images, axis=0).astype(np.uint8)))
        self._recent_s = time_s
        self._learning.clear()

    def _measure(self, view: Floats) -> tuple[Tiles, Array]:
        """The tiles that are found best, and their shifts, px, shape (n, 2)."""
        assert self._calibrated is not None
        shifts = self._calibrated.shifts(view)
        # Two limits, so that the sets do not take turns.
        uses_recent = bool(self._shifts) and self._shifts[-1][1] is self._recent
        if self._recent is None or _lost(shifts) <= (_FOUND_AGAIN_SHARE if uses_recent else SHARE):
            return self._calibrated, shifts
        later = self._recent.shifts(view) + self._recent_shift
        if uses_recent or _lost(later) < _lost(shifts):
            return self._recent, later
        return self._calibrated, shifts

    def _judge(self) -> bool:
        rows = np.stack([shifts for _, _, shifts in self._shifts])
        if not rows.shape[1]:
            return False  # nothing in this view could be recognised in the first place
        seen = np.isfinite(rows[..., 0]).mean(axis=0) >= 0.5
        if seen.mean() < 1 - _LOST_SHARE:
            return True
        found = rows[:, seen]
        middle = np.nanmedian(found, axis=0)
        shakes = np.nanmedian(np.linalg.norm(found - middle, axis=2), axis=0)
        moved = _displaced(self._shifts[-1][1].centres[seen], middle, self._corners)
        return bool(moved > self._max_px or np.median(shakes) > _SHAKE_TO_SHIFT * self._max_px)

    def _renew(self, time_s: float, view: Floats, shifts: Array) -> None:
        if _lost(shifts) > SHARE:
            return
        tiles = self._choose(view)
        if len(tiles) >= _MIN_TILES:
            self._recent, self._recent_s = tiles, time_s
            self._recent_shift = np.nanmedian(shifts, axis=0)


def _lost(shifts: Array) -> float:
    return float(np.isnan(shifts[:, 0]).mean()) if len(shifts) else 1.0


def _hull(road: Mask) -> Array:
    """Corners of the convex hull of the road, or of all of the image if it has none, (n, 2) px."""
    rows, columns = np.nonzero(road if road.any() else np.ones_like(road))
    hull = cv2.convexHull(np.column_stack([columns, rows]).astype(np.int32))
    return np.asarray(hull, dtype=np.float64).reshape(-1, 2)


def _displaced(centres: Array, shifts: Array, points: Array) -> float:
    """How far the points move at most if the tiles at the centres shift so, px."""
    spread = float(centres.std(axis=0).max()) if len(centres) else 0.0
    if len(centres) >= _MIN_FITTED and spread > _MIN_SPREAD * float(np.ptp(points, axis=0).max()):
        transform, _ = cv2.estimateAffinePartial2D(centres, centres + shifts, method=cv2.LMEDS)
        if transform is not None:
            moved = cv2.transform(points[None], np.asarray(transform))[0] - points
            return float(np.linalg.norm(moved, axis=1).max())
    return float(np.linalg.norm(np.median(shifts, axis=0)))

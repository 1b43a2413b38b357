"""A moved camera: does the picture still show what was calibrated?

Pieces beside the road are looked up in each picture. The calibrated view is compared first; where
light or season no longer let it be recognised, a picture of some minutes ago, whose own shift was
measured, stands in.
"""

from __future__ import annotations

import logging
from collections import deque

import numpy as np

from edge_daemon.camera import Array
from edge_daemon.watch.sample import Floats, Grey, Mask, texture
from edge_daemon.watch.tiles import Tiles, choose_tiles

log = logging.getLogger(__name__)

_LEARN_S = 4.0
_LEARN_PICTURES = 9
_FEWEST_TILES = 6
_MOVED_VOTES = 0.5
_LOST_VOTES = 0.7
_RECENT_S = 300.0


class ViewJudge:
    """Follows the shift of a camera's view against the calibrated one."""

    def __init__(
        self, limit_share: float, after_s: float, road: Mask, reference: Grey | None
    ) -> None:
        """Set it up.

        Args:
            limit_share: shift that counts as moved, as a share of the picture's width.
            after_s: time over which shifts are taken the median of.
            road: where vehicles drive in the small picture.
            reference: small picture of the calibrated view; None: learned from the first seconds.
        """
        self._limit_px = limit_share * road.shape[1]
        self._after_s = after_s
        self._road = road
        self._learning: deque[tuple[float, Grey]] = deque()
        self._calibrated: Tiles | None = None
        if reference is not None:
            self._calibrated = self._choose(texture(reference))
        self._recent: Tiles | None = None
        self._recent_s = 0.0
        self._recent_shift = np.zeros(2)
        self._shifts: deque[tuple[float, Array]] = deque()

    @property
    def is_learned(self) -> bool:
        """Whether the calibrated view is known yet."""
        return self._calibrated is not None

    def look(self, time_s: float, small: Grey, picture: Floats) -> bool:
        """True if the camera looks elsewhere than it did when it was calibrated.

        Args:
            time_s: media time, in order.
            small: grey picture of the mask's shape, of a scene that can be seen.
            picture: its `texture`.
        """
        if self._calibrated is None:
            self._learn(time_s, small)
            return False
        shifts = self._measure(picture)
        if len(self._shifts) and len(self._shifts[-1][1]) != len(shifts):
            self._shifts.clear()
        self._shifts.append((time_s, shifts))
        while time_s - self._shifts[0][0] > self._after_s:
            self._shifts.popleft()
        if time_s - self._shifts[0][0] < 0.7 * self._after_s:
            return False
        moved = self._judge()
        if not moved and time_s - self._recent_s > _RECENT_S:
            self._renew(time_s, picture, shifts)
        return moved

    def restart(self) -> None:
        """Forget shifts measured so far, not the view: after a fault of another kind."""
        self._shifts.clear()
        self._learning.clear()

    def _choose(self, picture: Floats) -> Tiles:
        tiles = choose_tiles(picture, ~self._road)
        if len(tiles) < _FEWEST_TILES:
            # A picture full of road: its markings have to do.
            tiles = choose_tiles(picture, np.ones_like(self._road))
        if not len(tiles) and self._calibrated is None:
            log.warning("the view has nothing to recognise: a moved camera would go unnoticed")
        return tiles

    def _learn(self, time_s: float, small: Grey) -> None:
        self._learning.append((time_s, small))
        if time_s - self._learning[0][0] < _LEARN_S or len(self._learning) < _FEWEST_TILES:
            return
        chosen = np.linspace(0, len(self._learning) - 1, _LEARN_PICTURES).astype(int)
        pictures = np.stack([self._learning[i][1] for i in sorted(set(chosen))])
        # The median leaves out what only drives through.
        self._calibrated = self._choose(texture(np.median(pictures, axis=0).astype(np.uint8)))
        self._recent_s = time_s
        self._learning.clear()

    def _measure(self, picture: Floats) -> Array:
        assert self._calibrated is not None
        shifts = self._calibrated.shifts(picture)
        if self._recent is None or _lost(shifts) <= _MOVED_VOTES:
            return shifts
        later = self._recent.shifts(picture) + self._recent_shift
        return later if _lost(later) < _lost(shifts) else shifts

    def _judge(self) -> bool:
        rows = np.stack([shifts for _, shifts in self._shifts])
        if not rows.shape[1]:
            return False  # nothing in this view could be recognised in the first place
        seen = np.isfinite(rows[..., 0]).mean(axis=0) >= 0.5
        if seen.mean() < 1 - _LOST_VOTES:
            return True
        middle = np.nanmedian(rows[:, seen], axis=0)
        return bool((np.hypot(*middle.T) > self._limit_px).mean() > _MOVED_VOTES)

    def _renew(self, time_s: float, picture: Floats, shifts: Array) -> None:
        if _lost(shifts) > _MOVED_VOTES:
            return
        tiles = self._choose(picture)
        if len(tiles) >= _FEWEST_TILES:
            self._recent, self._recent_s = tiles, time_s
            self._recent_shift = np.nanmedian(shifts, axis=0)


def _lost(shifts: Array) -> float:
    return float(np.isnan(shifts[:, 0]).mean()) if len(shifts) else 1.0

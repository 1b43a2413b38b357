"""`corrupt`: frames with decoding errors: flat or streaky parts, wrong macroblocks, trails.

After lost or damaged packets a decoder goes on with what it has: vehicles leave trails on the road
until the next key frame, and no error is told (`trails`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import ClassVar, Final

import numpy as np

from edge_daemon.frame import Image
from edge_daemon.watch.background import Background
from edge_daemon.watch.sample import Grey, Sample, grid_step, to_grey
from edge_daemon.watch.trails import BareRoad
from slipstream.messages import CameraFault

_BLOCK_PX: Final = 16
_MAX_BLOCK_LEVELS: Final = 6.0
_BLACK: Final = 16
_WHITE: Final = 240
_RECENT_FRAMES: Final = 10
_MIN_DAMAGED: Final = 2
_TRAIL_SAMPLES: Final = 10


def repeated_share(colours: Image, grey: Grey) -> float:
    """Share of sampled pixels that exactly equal the one below (or, if more, the one beside) them.

    A decoder fills lost parts with one colour or with streaks. Pixels eight apart seldom agree in
    an intact frame. Black and white do not count: night, glare and drawn text agree too.

    Args:
        colours: sampled pixels, BGR, shape (h, w, 3).
        grey: the same as grey levels, shape (h, w).

    Returns:
        A share in [0, 1].
    """
    wide = colours.astype(np.uint32)
    codes = wide[..., 0] << 16 | wide[..., 1] << 8 | wide[..., 2]
    counts = (grey >= _BLACK) & (grey <= _WHITE)
    below = np.count_nonzero((codes[1:] == codes[:-1]) & counts[1:])
    beside = np.count_nonzero((codes[:, 1:] == codes[:, :-1]) & counts[:, 1:])
    return max(below, beside) / max(1, codes.size)


def blockiness(image: Image) -> float:
    """How much stronger grey levels step at the edges of macroblocks than elsewhere, levels."""
    step = grid_step(image.shape[1])
    rows = to_grey(np.ascontiguousarray(image[step // 2 :: 2 * step])).astype(np.int16)
    steps = np.abs(np.diff(rows, axis=1)).mean(axis=0)
    at_edge = np.arange(1, steps.size + 1) % _BLOCK_PX == 0
    if not at_edge.any() or at_edge.all():
        return 0.0
    return float(steps[at_edge].mean() - steps[~at_edge].mean())


class CorruptJudge:
    """Looks for damaged frames, of which a single one does no harm, and for trails."""

    fault: ClassVar[CameraFault] = "corrupt"
    every_frame: ClassVar[bool] = False
    hides_scene: ClassVar[bool] = True

    def __init__(
        self,
        max_repeated_share: float,
        background: Background,
        bare_road: BareRoad,
        is_blind: Callable[[], bool],
    ) -> None:
        """Set it up.

        Args:
            max_repeated_share: a frame with a larger `repeated_share` is damaged.
            background: of the view; this judge takes the samples in.
            bare_road: what trails are told from.
            is_blind: whether vehicles are not detected, which then look like trails.
        """
        self.after_s = 0.0
        self._max_repeated_share = max_repeated_share
        self._recent: deque[bool] = deque(maxlen=_RECENT_FRAMES)
        self._background = background
        self._bare_road = bare_road
        self._is_blind = is_blind
        self._trails: deque[bool] = deque(maxlen=_TRAIL_SAMPLES)

    def look(self, sample: Sample) -> bool:
        """True if this frame and another of the last ten are damaged, or trails last for 2 s."""
        damaged = (
            repeated_share(sample.colours, sample.grey) > self._max_repeated_share
            or blockiness(sample.frame.image) > _MAX_BLOCK_LEVELS
        )
        self._recent.append(damaged)
        if damaged:
            return sum(self._recent) >= _MIN_DAMAGED
        return self._has_trails(sample)

    def interrupt(self, by: CameraFault | None) -> None:
        """Damage counts across gaps; the road may look different after one."""
        self._background.restart()
        self._bare_road.restart()
        self._trails.clear()

    def _has_trails(self, sample: Sample) -> bool:
        boxes = sample.boxes if sample.all_boxes is None else sample.all_boxes
        if boxes is not None:
            self._background.update(sample.small)
            changed = self._background.changed
            if changed is not None:
                found = self._bare_road.has_trails(sample.small, changed, boxes)
                self._trails.append(found and not self._is_blind())
        return 2 * sum(self._trails) > _TRAIL_SAMPLES

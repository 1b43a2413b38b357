"""Pictures that a decoder could not make whole: flat or streaky parts, or wrong macroblocks."""

from __future__ import annotations

from collections import deque

import numpy as np

from edge_daemon.frame import Image
from edge_daemon.watch.sample import Grey, Sample, grid_step, to_grey

_BLOCK_PX = 16
_BLOCK_LEVELS = 6.0
_BLACK, _WHITE = 16, 240
_REMEMBERED = 10
_BAD = 2


def repeated_share(colours: Image, grey: Grey) -> float:
    """Share of sampled pixels that exactly equal the one below (or, if more, the one beside) them.

    A decoder fills what it lost with one colour or with streaks. Pixels eight apart seldom agree
    in a real picture. Black and white are left out: night, glare and drawn text agree too.

    Args:
        colours: sampled pixels, BGR, shape (h, w, 3).
        grey: the same in grey, shape (h, w).

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
    """Tells damaged pictures from the camera's usual ones."""

    def __init__(self, max_repeated_share: float) -> None:
        self._max_repeated_share = max_repeated_share
        self._recent: deque[bool] = deque(maxlen=_REMEMBERED)

    def look(self, sample: Sample) -> bool:
        """True if several of the last pictures were damaged; a single one does no harm."""
        damaged = (
            repeated_share(sample.colours, sample.grey) > self._max_repeated_share
            or blockiness(sample.image) > _BLOCK_LEVELS
        )
        self._recent.append(damaged)
        return damaged and sum(self._recent) >= _BAD

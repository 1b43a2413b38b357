"""Frames that show the frame before once more, as converters of frame rates and busy cameras send.

A repeat differs from its predecessor by what encoding it again does, a small part of what noise and
traffic change from one new frame to the next.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.frame import Frame, Image
from edge_daemon.sources.grid import PictureGrid

_STEP_PX: Final = 8
_MEMORY_FRAMES: Final = 90
_MIN_FRAMES: Final = 10
_USUAL_PERCENTILE: Final = 90.0
_MAX_OF_USUAL: Final = 0.25
LEVELS: Final = 12
_MAXSHARE: Final = 1.5e-4
"""Two of the sampled pixels of 720p: what moves crosses more of them, be it a single car."""
_MAX_GAP_S: Final = 0.45
"""Between frames that count as new: traffic may stand. Below what the pipeline takes for a hole."""


def mark_repeats(frames: Iterable[Frame | None]) -> Iterator[Frame | None]:
    """The same frames, those that repeat their predecessor marked as `repeated`, the others with
    the time at which they were taken, where a `PictureGrid` tells it.
    """
    finder, grid = RepeatFinder(), PictureGrid()
    last_s = 0.0
    for frame in frames:
        if frame is None:
            yield None
            continue
        repeated, time_s = finder.is_repeat(frame), frame.media_time_s
        if frame.cut:
            grid.restart()
            last_s = time_s
        if not repeated:
            time_s = grid.taken_s(time_s)
        last_s = max(last_s, time_s)
        yield replace(frame, repeated=repeated, media_time_s=last_s)


class RepeatFinder:
    """Compares sampled pixels of each frame with those of the last new one."""

    def __init__(self) -> None:
        self._new: npt.NDArray[np.uint8] | None = None
        self._new_s = self._last_s = 0.0
        self._changes: deque[float] = deque(maxlen=_MEMORY_FRAMES)

    def is_repeat(self, frame: Frame) -> bool:
        """Whether a frame shows what the last new one showed; frames come in order of time."""
        sample, now_s = _sample(frame.image), frame.media_time_s
        last = None if frame.cut else self._new
        step_s, self._last_s = now_s - self._last_s, now_s
        repeats = False
        if last is not None and last.shape == sample.shape:
            change = cv2.absdiff(sample, last)
            level = float(change.mean())
            moved = np.count_nonzero(change > LEVELS)
            repeats = bool(
                len(self._changes) >= _MIN_FRAMES
                # The next one would come too late to be the next new one.
                and now_s - self._new_s + step_s <= _MAX_GAP_S
                and moved <= _MAXSHARE * change.size
                and level < _MAX_OF_USUAL * np.percentile(self._changes, _USUAL_PERCENTILE)
            )
            self._changes.append(level)
        if not repeats:
            self._new, self._new_s = sample, now_s
        return repeats


def _sample(image: Image) -> npt.NDArray[np.uint8]:
    pixels = np.ascontiguousarray(image[_STEP_PX // 2 :: _STEP_PX, _STEP_PX // 2 :: _STEP_PX])
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), dtype=np.uint8)

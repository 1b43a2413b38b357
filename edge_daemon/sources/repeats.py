"""Frames that show the frame before once more, as converters of frame rates and busy cameras send.

Tracks take a repeated frame for vehicles that stopped and then leapt. A repeat differs from its
predecessor by what encoding it again does, a small part of what noise and traffic change from one
new frame to the next.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.frame import Frame, Image

_STEP_PX: Final = 8
_MEMORY_FRAMES: Final = 90
_MIN_FRAMES: Final = 10
_USUAL_PERCENTILE: Final = 90.0
_SLIGHT_LEVEL: Final = 0.25
_SLIGHT_MOVED: Final = 0.1
_MIN_USUAL_MOVED: Final = 0.005
_MOVED_LEVELS: Final = 12
_MAX_MOVED_SHARE: Final = 0.002
MAX_GAP_S: Final = 0.45
"""A frame that comes so long after the last new one counts as new: traffic may stand."""


def mark_repeats(frames: Iterable[Frame | None]) -> Iterator[Frame | None]:
    """The same frames, those that repeat their predecessor marked as `repeated`."""
    finder = RepeatFinder()
    for frame in frames:
        if frame is not None and finder.is_repeat(frame):
            yield replace(frame, repeated=True)
        else:
            yield frame


class _Change(NamedTuple):
    """How two frames differ: mean change of grey levels, share of pixels that something crossed."""

    level: float
    moved: float

    @classmethod
    def between(cls, last: npt.NDArray[np.uint8], now: npt.NDArray[np.uint8]) -> _Change:
        change = cv2.absdiff(now, last)
        return cls(float(change.mean()), np.count_nonzero(change > _MOVED_LEVELS) / change.size)


class RepeatFinder:
    """Compares sampled pixels of each frame with those of the last new one."""

    def __init__(self) -> None:
        self._new: npt.NDArray[np.uint8] | None = None
        self._new_s = 0.0
        self._changes: deque[_Change] = deque(maxlen=_MEMORY_FRAMES)

    def is_repeat(self, frame: Frame) -> bool:
        """Whether a frame shows what the last new one showed; frames come in order of time."""
        sample = _sample(frame.image)
        last = None if frame.cut else self._new
        repeats = False
        if last is not None and last.shape == sample.shape:
            change = _Change.between(last, sample)
            soon = frame.media_time_s - self._new_s < MAX_GAP_S
            repeats = soon and self._is_slight(change)
            self._changes.append(change)
        if not repeats:
            self._new, self._new_s = sample, frame.media_time_s
        return repeats

    def _is_slight(self, change: _Change) -> bool:
        if len(self._changes) < _MIN_FRAMES:
            return False
        level, moved = np.percentile(self._changes, _USUAL_PERCENTILE, axis=0)
        # A key frame is encoded so anew that all levels change, but nothing moves in it.
        return change.moved < _MAX_MOVED_SHARE and (
            change.level < _SLIGHT_LEVEL * level
            or (moved > _MIN_USUAL_MOVED and change.moved < _SLIGHT_MOVED * moved)
        )


def _sample(image: Image) -> npt.NDArray[np.uint8]:
    pixels = np.ascontiguousarray(image[_STEP_PX // 2 :: _STEP_PX, _STEP_PX // 2 :: _STEP_PX])
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), dtype=np.uint8)

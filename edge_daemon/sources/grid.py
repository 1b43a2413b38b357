"""The true times of pictures that a converter of frame rates has shown too late.

A converter shows, at each tick of its own rate, the newest picture that it has. The pictures were
taken at even distances, and each is told late by up to one tick: their distances are n and n + 1
ticks, as evenly mixed as whole numbers allow. A line through their times tells when they were
taken. Where distances are not of that kind, as of a camera that leaves pictures out at random,
times stay as they are, and by how much they are wrong is learned from vehicles (`tracking.timing`).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from edge_daemon.camera import Array

_MEMORY: Final = 128
_MIN_PICTURES: Final = 24
_MIN_OF_A_KIND: Final = 6
"""Distances that are few may be mixed evenly by chance."""
_MIN_TICK_S: Final = 0.004
_ROUNDED_S: Final = 0.002
"""Containers tell times in whole milliseconds."""
_NEAR_TICKS: Final = 0.15
_MAX_SPREAD_TICKS: Final = 1.1
_MAX_MISFITS: Final = 5


class PictureGrid:
    """Finds when the distinct pictures of a stream were taken, from when each was first shown."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """The next picture follows none."""
        self._shown_s: list[float] = []
        self._numbers: list[int] = []
        self._late_s: float | None = None
        self._misfits = 0

    def taken_s(self, shown_s: float) -> float:
        """When the next picture was taken, s, on average as late as it was shown; what was shown
        where nothing better is known.
        """
        if self._late_s is not None:
            slope, begin = self._line()
            number = round((shown_s - begin) / slope)
            # One that was left out is a number more, a repeat that passed for new none.
            if abs(shown_s - begin - slope * number) <= self._late_s:
                self._misfits = 0
                self._append(shown_s, number)
                return self._last_s()
            self._misfits += 1
            if self._misfits < _MAX_MISFITS:
                return shown_s
            self.restart()
        self._append(shown_s, self._numbers[-1] + 1 if self._numbers else 0)
        return self._last_s() if self._is_found() else shown_s

    def _append(self, shown_s: float, number: int) -> None:
        self._shown_s = [*self._shown_s[1 - _MEMORY :], shown_s]
        self._numbers = [*self._numbers[1 - _MEMORY :], number]

    def _line(self) -> Array:
        """Distance of the pictures and time of number 0, s."""
        return np.polyfit(self._numbers, self._shown_s, 1)

    def _last_s(self) -> float:
        slope, begin = self._line()
        return float(begin + slope * self._numbers[-1])

    def _is_found(self) -> bool:
        """Look for a grid in the last pictures."""
        while len(self._shown_s) >= _MIN_PICTURES:
            shown = np.array(self._shown_s)
            steps = np.diff(shown)
            tick_s, short_s = float(np.ptp(steps)), float(steps.min())
            if tick_s < _MIN_TICK_S:
                break
            if _is_even(shown, steps, short_s, tick_s):
                longer = int(np.count_nonzero(steps > short_s + tick_s / 2))
                if min(longer, len(steps) - longer) < _MIN_OF_A_KIND:
                    break
                self._late_s = _MAX_SPREAD_TICKS * tick_s / 2 + _ROUNDED_S
                return True
            # A pause, a repeat that passed for new, a picture that was left out: it goes on behind.
            del self._shown_s[: len(steps) // 2], self._numbers[: len(steps) // 2]
        return False


def _is_even(shown_s: Array, steps_s: Array, short_s: float, tick_s: float) -> bool:
    """Whether distances are of two kinds, a tick apart, and mixed as those of a line's are."""
    above = steps_s - short_s
    near_s = _NEAR_TICKS * tick_s + _ROUNDED_S
    if tick_s > short_s + near_s or np.minimum(above, tick_s - above).max() > near_s:
        return False
    number = np.arange(len(shown_s))
    slope, begin = np.polyfit(number, shown_s, 1)
    late = shown_s - begin - slope * number
    return float(np.ptp(late)) <= _MAX_SPREAD_TICKS * tick_s + _ROUNDED_S

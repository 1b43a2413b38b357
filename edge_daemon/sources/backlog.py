"""Which frames of a live stream were queued on their way and arrive in a burst."""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import Final, NamedTuple

# A longer silence cuts the time line: tracking restarts after it.
_MAX_SILENCE_S: Final = 0.5
_MIN_INTERVAL_S = 0.004
_BURST_RATE = 0.5
_INTERVALS = 31


class Arrival(NamedTuple):
    """Classification of a frame by its arrival.

    Attributes:
        old: it was queued: its time of arrival says nothing of when it was taken.
        cut: it does not follow the last one that was not old as their times of arrival say.
    """

    old: bool
    cut: bool


class Backlog:
    """Classifies the arrivals of one connection.

    Where frames carry no time stamp, those after a silence are old until one keeps half of the
    usual distance: decoding alone spaces those of a backlog by some milliseconds.
    """

    def __init__(self) -> None:
        """Start a connection."""
        self._arrival_s: float | None = None
        self._stamp_s: float | None = None
        self._steps: deque[float] = deque(maxlen=_INTERVALS)
        self._drained_by_s: float | None = None
        self._dropped = False

    def classify(self, arrival_s: float, stamp_s: float | None) -> Arrival:
        """Classify the frame that has just arrived, with its time stamp in the stream, if it has
        one.
        """
        last_s, previous_s = self._arrival_s, self._stamp_s
        self._arrival_s, self._stamp_s = arrival_s, stamp_s
        if last_s is None:
            # The first waited for the connection; one without a stamp may be the only one.
            return Arrival(old=stamp_s is not None, cut=False)
        step_s = arrival_s - last_s
        if previous_s is not None and stamp_s is not None:
            return self._by_stamps(step_s, stamp_s - previous_s)
        return self._by_arrivals(arrival_s, step_s)

    @staticmethod
    def _by_stamps(step_s: float, stamps_s: float) -> Arrival:
        rushes = 0 < stamps_s < _MAX_SILENCE_S and step_s < _BURST_RATE * stamps_s
        return Arrival(old=step_s < _MIN_INTERVAL_S or rushes, cut=step_s > _MAX_SILENCE_S)

    def _by_arrivals(self, arrival_s: float, step_s: float) -> Arrival:
        if step_s > _MAX_SILENCE_S:
            # At twice the camera's rate or more, what piled up is through after as long again.
            self._drained_by_s, self._dropped = arrival_s + step_s, False
            return Arrival(old=False, cut=True)
        if self._drained_by_s is not None:
            return self._drain_queue(step_s, in_time=arrival_s <= self._drained_by_s)
        if step_s < _MIN_INTERVAL_S:
            return Arrival(old=True, cut=False)
        self._steps.append(step_s)
        return Arrival(old=False, cut=False)

    def _drain_queue(self, step_s: float, *, in_time: bool) -> Arrival:
        usual_s = median(self._steps) if self._steps else 0.0
        if in_time and step_s < max(_MIN_INTERVAL_S, _BURST_RATE * usual_s):
            self._dropped = True
            return Arrival(old=True, cut=False)
        if not in_time:
            # The camera has another rate now.
            self._steps.clear()
        # The frame that ended the silence was the oldest of those that piled up.
        cut, self._dropped, self._drained_by_s = self._dropped, False, None
        return Arrival(old=False, cut=cut)

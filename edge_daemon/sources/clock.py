"""Media time of a live stream: its own clock where it has one, else smoothed times of arrival.

Times of arrival jitter by what network and scheduling add; at 30 frames a second 10 ms are a
third of the frame interval, and would appear as acceleration.
"""

from __future__ import annotations

from collections import deque
from statistics import fmean, median
from typing import NamedTuple

_SLACK_S = 0.5
_SLACK_RATE = 0.02
_LATE_S = 2.0
_LEAP_S = 1.0
_MAX_RESETS = 3
_LEARNED = 30
_MAX_OUTLIERS = 10
_GATE = 0.45
_GAIN = 0.1
_RATE_GAIN = 0.003
_TICK_S = 1e-3


class MediaTime(NamedTuple):
    """When a frame was taken.

    Attributes:
        time_s: media time.
        cut: a new time line begins with it: times before are not comparable.
        jumped: that is because the stream's clock ran back or leapt.
    """

    time_s: float
    cut: bool
    jumped: bool


class StreamClock:
    """Assigns media times to the frames of one connection, none before `not_before_s`; they never
    decrease.
    """

    def __init__(self, not_before_s: float = 0.0) -> None:
        self._last_s = not_before_s
        self._arrival_s: float | None = None
        self._stream_s: float | None = None
        self._anchor: tuple[float, float] | None = None
        self._resets = 0
        self._jumps = 0
        self._advances = False
        self._late_since_s: float | None = None
        self._interval_s: float | None = None
        self._outliers = 0
        self._steps: deque[float] = deque(maxlen=_LEARNED)

    def media_time(self, arrival_s: float, stream_s: float | None) -> MediaTime:
        """The media time of the frame that has just come, at a time on the line that media times
        follow, with its time stamp in the stream, if it has one.
        """
        resets = self._resets
        if stream_s is not None and self._stream_s is not None:
            self._advances |= stream_s > self._stream_s
        jumped = self._jumped(arrival_s, stream_s)
        self._jumps = self._jumps + 1 if jumped else 0
        if self._jumps > _MAX_RESETS:
            # It stands still, or says anything: no clock.
            self._resets = _MAX_RESETS
        is_used = self._resets < _MAX_RESETS and (self._advances or self._stream_s is None)
        if stream_s is not None and not jumped and is_used:
            time_s = self._by_stream(arrival_s, stream_s)
        else:
            self._anchor = None
            time_s = self._by_arrival(arrival_s)
        if self._arrival_s is not None:
            self._steps.append(arrival_s - self._arrival_s)
        self._arrival_s, self._stream_s = arrival_s, stream_s
        self._last_s = max(time_s, self._last_s + _TICK_S)
        return MediaTime(self._last_s, jumped or self._resets > resets, jumped)

    def _jumped(self, arrival_s: float, stream_s: float | None) -> bool:
        if stream_s is None or self._stream_s is None or self._arrival_s is None:
            return False
        if not self._advances or self._resets >= _MAX_RESETS:
            return False
        step_s = stream_s - self._stream_s
        return step_s <= 0 or step_s > arrival_s - self._arrival_s + _LEAP_S

    def _by_stream(self, arrival_s: float, stream_s: float) -> float:
        if self._anchor is None:
            self._anchor = (arrival_s, stream_s)
        anchor_s, stream_anchor_s = self._anchor
        passed_s = stream_s - stream_anchor_s
        late_s = arrival_s - anchor_s - passed_s
        slack_s = _SLACK_S + _SLACK_RATE * passed_s
        if late_s <= slack_s:
            self._late_since_s = None
        elif self._late_since_s is None:
            self._late_since_s = arrival_s
        # A stall of the network makes frames late for a moment; their own times stay right.
        if late_s < -slack_s or self._is_late_for_long(arrival_s):
            self._resets += 1
            self._late_since_s = None
            self._anchor = (arrival_s, stream_s)
            return arrival_s
        return anchor_s + passed_s

    def _is_late_for_long(self, arrival_s: float) -> bool:
        return self._late_since_s is not None and arrival_s - self._late_since_s > _LATE_S

    def _by_arrival(self, arrival_s: float) -> float:
        """Near the usual interval, follow the interval; else (a hole, a burst) the arrival."""
        if self._interval_s is None:
            self._interval_s = self._usual_interval_s()
        if self._interval_s is None:
            return arrival_s
        expected_s = self._last_s + self._interval_s
        error_s = arrival_s - expected_s
        if abs(error_s) < _GATE * self._interval_s:
            self._outliers = 0
            self._interval_s += _RATE_GAIN * error_s
            return expected_s + _GAIN * error_s
        self._outliers += 1
        if self._outliers >= _MAX_OUTLIERS:
            # The camera has another rate now.
            self._outliers, self._interval_s = 0, None
            self._steps.clear()
        return arrival_s

    def _usual_interval_s(self) -> float | None:
        """Mean time between the last frames, s; None where holes make it none."""
        if len(self._steps) < _LEARNED or max(self._steps) > 2 * median(self._steps):
            return None
        return fmean(self._steps)

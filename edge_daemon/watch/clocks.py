"""Clocks that step: the stream's own, and the machine's wall clock."""

from __future__ import annotations

from edge_daemon.frame import Frame

_LEAP_S = 5.0
_SLACK_S = 2.0


class ClockJudge:
    """Compares media time and wall clock with the monotonic clock, which never steps."""

    def __init__(self, step_s: float) -> None:
        self._step_s = step_s
        self._last: Frame | None = None
        self._wall_s: float | None = None
        self._steps = 0

    def look(self, frame: Frame) -> bool:
        """True if a clock stepped before this frame."""
        last, self._last = self._last, frame
        jumped = frame.clock_jump or (last is not None and _leapt(last, frame))
        return self._wall_stepped(frame) or jumped

    def _wall_stepped(self, frame: Frame) -> bool:
        # Since 1970 a double resolves 0.2 µs: enough here.
        wall_s = frame.captured_ns / 1e9 - frame.captured_s
        if self._wall_s is None or abs(wall_s - self._wall_s) < self._step_s:
            # Slewing, as NTP does it, is no step: the comparison moves along.
            self._wall_s = wall_s
            self._steps = 0
            return False
        # Once may be a thread that slept between reading one clock and the other.
        self._steps += 1
        if self._steps < 2:
            return False
        self._wall_s = wall_s
        self._steps = 0
        return True


def _leapt(last: Frame, frame: Frame) -> bool:
    media_s = frame.media_time_s - last.media_time_s
    passed_s = frame.captured_s - last.captured_s
    return media_s < 0 or media_s > max(_LEAP_S, passed_s + _SLACK_S)

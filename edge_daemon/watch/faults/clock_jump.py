"""`clock_jump`: a clock that stepped, the stream's own or the machine's wall clock."""

from __future__ import annotations

from typing import ClassVar, Final

from edge_daemon.frame import Frame
from edge_daemon.watch.judge import FaultJudge
from edge_daemon.watch.sample import Sample
from slipstream.messages import CameraFault

_STEP_S: Final = 0.5
"""From here up a step of the wall clock counts."""
_MAX_LEAP_S: Final = 5.0
_SLACK_S: Final = 2.0


class ClockJumpJudge(FaultJudge):
    """Compares media time and wall clock with the monotonic clock, which never steps; a step of the
    wall clock counts from `step_s` on.
    """

    fault: ClassVar[CameraFault] = "clock_jump"
    every_frame: ClassVar[bool] = True

    def __init__(self) -> None:
        self._last: Frame | None = None
        self._wall_s: float | None = None
        self._steps = 0

    def look(self, sample: Sample) -> bool:
        """True if a clock stepped before this frame."""
        frame = sample.frame
        last, self._last = self._last, frame
        jumped = frame.clock_jump or (last is not None and _leapt(last, frame))
        return self._wall_stepped(frame) or jumped

    def _wall_stepped(self, frame: Frame) -> bool:
        # Since 1970 a double resolves 0.2 µs: enough here.
        wall_s = frame.captured_ns / 1e9 - frame.captured_s
        if self._wall_s is None or abs(wall_s - self._wall_s) < _STEP_S:
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
    return media_s < 0 or media_s > max(_MAX_LEAP_S, passed_s + _SLACK_S)

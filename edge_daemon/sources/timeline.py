"""Media times of the frames of one clip, by its time stamps or its rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from edge_daemon.sources.rate import Rate

_BACK_S: Final = 0.5
_LEAP_S: Final = 10.0
_MAX_STEP_S: Final = 1.0
_GAP_S: Final = 0.5
_GAP_STEPS: Final = 4.0
_DIFFERS_S: Final = 0.1
_DIFFERS: Final = 0.02


@dataclass(frozen=True)
class Moment:
    """When a frame was taken, and what lies before it.

    Attributes:
        time_s: media time.
        gap_s: since the frame before, by the time stamps; 0: they follow each other.
        jumped: whether the time stamps ran back, or leapt so far that the scene is another one.
        left_out_s: of such a leap, what media time does not count.
    """

    time_s: float
    gap_s: float = 0.0
    jumped: bool = False
    left_out_s: float = 0.0


class Timeline:
    """Assigns media times to the frames of a clip; they never decrease. `begin_s` is that of the
    first, `step_s` the distance of frames before it, None: there were none.

    Attributes:
        frames: how many have been shown.
        last_s: media time of the last one.
        step_s: the last distance between two frames.
        differs: whether a rate that was given contradicts the clip's own time stamps.
    """

    def __init__(self, rate: Rate, begin_s: float, step_s: float | None = None) -> None:
        self._rate = rate
        self._shift_s = begin_s
        self._first_s = self._position_s = 0.0
        self.frames = 0
        self.step_s = min(1 / rate.fps, _MAX_STEP_S) if step_s is None else step_s
        self.last_s = begin_s - self.step_s
        self.differs = False

    @property
    def next_s(self) -> float:
        """Media time at which the last frame ends."""
        return self.last_s + self.step_s

    @property
    def shown_s(self) -> float:
        """From the first frame to the end of the last one, by the clip's time stamps."""
        return self._position_s - self._first_s + self.step_s

    def next(self, position_s: float) -> Moment:
        """The time of the next frame, by its time stamp, as FFmpeg says it."""
        if self.frames == 0:
            self._first_s = self._position_s = position_s
        before_s, self._position_s = self._position_s, position_s
        passed_s = self.frames / self._rate.fps
        if self._rate.source == "time stamps":
            moment = self._by_stamps(position_s - self._first_s, position_s - before_s)
        else:
            moment = Moment(self._shift_s + passed_s)
            off_s = abs(position_s - self._first_s - passed_s)
            self.differs |= self._rate.stamped and off_s > max(_DIFFERS_S, _DIFFERS * passed_s)
        if self.frames > 0:
            self.step_s = min(moment.time_s - self.last_s, _MAX_STEP_S)
        self.last_s = moment.time_s
        self.frames += 1
        return moment

    def _by_stamps(self, since_first_s: float, step_s: float) -> Moment:
        if self.frames == 0:
            return Moment(self._shift_s)
        expected_s, time_s = self.next_s, self._shift_s + since_first_s
        if step_s < -_BACK_S or step_s > _LEAP_S:
            self._shift_s = expected_s - since_first_s
            left_out_s = max(0.0, time_s - expected_s)
            return Moment(expected_s, max(0.0, step_s), jumped=True, left_out_s=left_out_s)
        # A few frames may share a time stamp, as with fields.
        if time_s <= self.last_s:
            return Moment(expected_s)
        is_gap = step_s > max(_GAP_S, _GAP_STEPS / self._rate.fps)
        return Moment(time_s, step_s if is_gap else 0.0)

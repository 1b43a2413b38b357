"""Passages by quarter hours of UTC: how many of each class, how fast, and for how long somebody
watched. No clock of its own.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final, get_args

import numpy as np

from edge_daemon.features.counts import Passage
from edge_daemon.features.kinematics import COMMON_SPEED_STD
from slipstream.messages import (
    QUARTER_HOUR_S,
    CameraFault,
    ClassCount,
    CountedClass,
    Estimate,
    SegmentCounts,
    UnwatchedReason,
)

MAX_GAP_S: Final = 0.5
"""A frame stands for the time since the one before it; where that is longer, nobody watched."""
MISCOUNTED: Final = 0.02
"""Share of the vehicles that are missed or counted twice where none hides another, measured on
renders."""
HIDDEN_MISSED: Final = 0.7
"""Share of the vehicles that are missed, over the square of the hidden share of the road: one has
to be hidden upstream and downstream. Measured on renders."""
UNKNOWN_HIDDEN: Final = 0.2
"""The hidden share where the camera's pose is not known, so that nothing tells it."""
MISCLASSIFIED: Final = 0.03
"""Share of the vehicles that are taken for another class, measured on renders."""
_LOST: Final = 0.5
"""What a vehicle adds to the variance that was lost before the cross-section."""
_UNSURE: Final = {"seen": 0.0, "joined": 0.1, "inferred": 0.25}
"""Variance of a passage by how it is known."""
_UNLIKE: Final = 0.5
"""Vehicles whose speed was not measured may on average be so many standard deviations off."""
_MIN_SPEEDS: Final = 10
"""Fewer have no 85th percentile."""
_QUANTILE: Final = 0.85
_Q_ERROR: Final = 1.53
"""Standard error of it over that of a mean, of a normal distribution."""
_QUARTER_NS: Final = round(QUARTER_HOUR_S * 1e9)
_SET_BACK_NS: Final = 2 * 10**9
"""Clocks jitter by less."""
_TELLING_S: Final = 5.0
"""Less unwatched time has no reason."""
_MOST_CLOSED: Final = 8


@dataclass(eq=False)
class _Counted:
    """What came on one segment: passages, vehicles that were lost, and the sum and number of the
    shares of it that vehicles hid.
    """

    passages: list[Passage] = field(default_factory=list)
    lost: int = 0
    hidden: float = 0.0
    looks: int = 0

    @property
    def hidden_share(self) -> float:
        return self.hidden / self.looks if self.looks else 0.0


@dataclass(eq=False)
class _Interval:
    """What came in one quarter hour, or in the part of it before or after the clock was set.

    Attributes:
        from_s: media time of its begin.
        to_s: of its end; inf while it runs.
        closed_ns: UTC at which it was seen to be over.
        until_ns: latest UTC in it.
        unwatched_s: by reason.
        told: segments whose counts have been handed out as complete.
    """

    began_ns: int
    from_s: float
    until_ns: int
    to_s: float = math.inf
    closed_ns: int = 0
    watched_s: float = 0.0
    unwatched_s: dict[UnwatchedReason, float] = field(default_factory=lambda: defaultdict(float))
    counted: dict[str, _Counted] = field(default_factory=dict)
    told: set[str] = field(default_factory=set)


class QuarterHours:
    """The running quarter hour and those that are not complete yet.

    Args:
        rsu: for the messages.
        segments: whose passages come.
        settle_s: for so long a passage may still come, or be taken back.
    """

    def __init__(self, rsu: str, segments: Iterable[str], settle_s: float) -> None:
        self._rsu, self._segments, self._settle_s = rsu, frozenset(segments), settle_s
        self._running: _Interval | None = None
        self._closed: deque[_Interval] = deque(maxlen=_MOST_CLOSED)
        self._recent: deque[tuple[float, float]] = deque()
        self._gaps: deque[tuple[float, float]] = deque(maxlen=64)
        self._last: tuple[float, int] | None = None
        self._unattributed_s = 0.0
        self._frames = 0

    def frame(self, time_s: float, time_ns: int, gap_s: float) -> None:
        """A frame that was looked at, `gap_s` after the one before, by media time and by UTC."""
        running = self._at(time_s, time_ns)
        self._frames += 1
        if gap_s > MAX_GAP_S:
            self._gaps.append((time_s - gap_s, time_s))
        elif gap_s > 0:
            running.watched_s += gap_s
            self._unattributed_s -= gap_s
            self._recent.append((time_s, gap_s))
        while self._recent and self._recent[0][0] < time_s - self._settle_s:
            self._recent.popleft()

    def tick(self, time_s: float, time_ns: int, fault: CameraFault | None) -> None:
        """Time has gone on, with frames or without: why nobody watched since the last call, as far
        as nobody did.
        """
        before, running = self._last, self._at(time_s, time_ns)
        self._last = time_s, time_ns
        if before is not None:
            elapsed_s, media_s = (time_ns - before[1]) / 1e9, time_s - before[0]
            self._unattributed_s = max(0.0, self._unattributed_s + elapsed_s)
            reason: UnwatchedReason
            if fault is not None:
                reason = fault
            elif self._frames and elapsed_s - media_s > _SET_BACK_NS / 1e9:
                reason = "clock_jump"
            else:
                reason = "low_frame_rate" if self._frames else "no_frames"
            if self._unattributed_s > 0:
                running.unwatched_s[reason] += self._unattributed_s
                self._unattributed_s = 0.0
        self._frames = 0

    def take_back(self) -> None:
        """What was watched and counted shortly before now is not to be trusted."""
        for time_s, gap_s in self._recent:
            interval = self._of(time_s)
            interval.watched_s = max(0.0, interval.watched_s - gap_s)
            self._unattributed_s += gap_s
        from_s = self._recent[0][0] if self._recent else math.inf
        for interval in self._intervals():
            for counted in interval.counted.values():
                counted.passages = [one for one in counted.passages if one.time_s < from_s]
        self._recent.clear()

    def add(self, segment: str, passages: Iterable[Passage], lost: int = 0) -> None:
        """Vehicles that have passed, and how many were lost before; those who passed while nobody
        watched do not count.
        """
        for passage in passages:
            if not any(begin_s < passage.time_s < end_s for begin_s, end_s in self._gaps):
                interval = self._of(passage.time_s)
                interval.counted.setdefault(segment, _Counted()).passages.append(passage)
        if lost and self._running is not None:
            self._running.counted.setdefault(segment, _Counted()).lost += lost

    def look(self, segment: str, hidden_share: float | None) -> None:
        """Vehicles are on a segment now and hide this share of it; None: it is not known."""
        if self._running is not None:
            counted = self._running.counted.setdefault(segment, _Counted())
            counted.hidden += UNKNOWN_HIDDEN if hidden_share is None else hidden_share
            counted.looks += 1

    def finish(self) -> None:
        """Nothing comes any more: what is over is complete."""
        self._settle_s = 0.0

    def complete(self, segment: str) -> list[SegmentCounts]:
        """The counts of the quarter hours that have become complete since the last call."""
        found = []
        now_ns = self._last[1] if self._last else 0
        for interval in list(self._closed):
            # Whichever way the clock was set.
            settled = abs(now_ns - interval.closed_ns) >= self._settle_s * 1e9
            if segment in interval.told or not settled:
                continue
            interval.told.add(segment)
            found.append(self._counts(segment, interval, complete=True))
            if interval.told >= self._segments:
                self._closed.remove(interval)
        return found

    def running(self, segment: str) -> SegmentCounts | None:
        """The counts of the running quarter hour until now; None: it has only begun."""
        interval = self._running
        if interval is None or interval.until_ns == interval.began_ns:
            return None
        return self._counts(segment, interval, complete=False)

    def _at(self, time_s: float, time_ns: int) -> _Interval:
        """The interval that runs at a time; that before ends when its quarter hour does, or when
        the clock is set back.
        """
        running = self._running
        if running is not None:
            ahead_ns = time_ns - running.until_ns
            is_set_back = ahead_ns < -_SET_BACK_NS
            if not is_set_back and time_ns < running.began_ns + _QUARTER_NS:
                running.until_ns = max(running.until_ns, time_ns)
                return running
            running.to_s, running.closed_ns = time_s, time_ns
            self._closed.append(running)
        began_ns = time_ns // _QUARTER_NS * _QUARTER_NS
        reason: UnwatchedReason = "not_running" if running is None else "clock_jump"
        follows = running is not None and began_ns == running.began_ns + _QUARTER_NS
        self._running = _Interval(began_ns, time_s, time_ns)
        if not follows:
            self._running.unwatched_s[reason] += (time_ns - began_ns) / 1e9
        return self._running

    def _intervals(self) -> list[_Interval]:
        return [*self._closed, *([] if self._running is None else [self._running])]

    def _of(self, time_s: float) -> _Interval:
        """The interval of a media time; of one that is told already, the one that runs."""
        assert self._running is not None
        for interval in self._closed:
            if interval.from_s <= time_s < interval.to_s and not interval.told:
                return interval
        return self._running

    def _counts(self, segment: str, interval: _Interval, *, complete: bool) -> SegmentCounts:
        until_ns = interval.began_ns + _QUARTER_NS if complete else interval.until_ns
        elapsed_s = (until_ns - interval.began_ns) / 1e9
        watched_s = min(interval.watched_s, elapsed_s)
        counted = interval.counted.get(segment, _Counted())
        mean, v85 = _speeds(counted.passages, watched_s / elapsed_s)
        missing_s = elapsed_s - watched_s
        longest = max(interval.unwatched_s.items(), key=lambda one: one[1], default=(None, 0.0))[0]
        return SegmentCounts(
            rsu=self._rsu,
            segment=segment,
            began_ns=interval.began_ns,
            until_ns=until_ns,
            complete=complete,
            watched_s=watched_s,
            reason=longest if missing_s > _TELLING_S else None,
            vehicles=_count(counted, None),
            classes=tuple(
                ClassCount(vehicle_class=name, vehicles=_count(counted, kind))
                for kind, name in enumerate(get_args(CountedClass))
            ),
            mean_speed_mps=mean,
            v85_mps=v85,
            speeds=sum(passage.speed_mps is not None for passage in counted.passages),
        )


def _count(counted: _Counted, kind: int | None) -> Estimate:
    """How many passed, of one class or of all, with the standard error of counting them.

    Single vehicles are missed or counted twice independently, and by all cameras and roads alike
    more or less often than where it was measured: a part of the error grows with their number.
    """
    passages = counted.passages
    of_it = [one for one in passages if kind is None or one.vehicle_class == kind]
    number = len(of_it)
    share = 1.0 if kind is None else number / len(passages) if passages else 0.25
    wrong = MISCOUNTED + HIDDEN_MISSED * counted.hidden_share**2
    variance = wrong * number + (wrong * number) ** 2 + _LOST * counted.lost * share
    variance += sum(_UNSURE[one.found] for one in of_it)
    if kind is not None:
        variance += MISCLASSIFIED * len(passages)
    return Estimate(value=float(number), standard_error=math.sqrt(variance))


def _speeds(
    passages: list[Passage], watched_share: float
) -> tuple[Estimate | None, Estimate | None]:
    """Mean and 85th percentile of the speeds, with standard errors: of measuring, and of the
    vehicles that nobody measured, of whom the others are a sample that may be unlike them.
    """
    known = [one for one in passages if one.speed_mps is not None]
    if not known:
        return None, None
    speeds = np.array([one.speed_mps for one in known])
    number = len(known)
    own = np.array([one.speed_std_mps or 0.0 for one in known])
    unmeasured = max(0.0, 1 - watched_share * number / len(passages))
    spread = float(speeds.var(ddof=1)) if number > 1 else float(speeds.mean() ** 2)
    mean = float(speeds.mean())
    variance = (unmeasured * spread + float(np.mean(own**2))) / number
    common = (COMMON_SPEED_STD * mean) ** 2 + (_UNLIKE * unmeasured) ** 2 * spread
    v85 = None
    if number >= _MIN_SPEEDS:
        v85 = Estimate(
            value=max(0.0, float(np.quantile(speeds, _QUANTILE))),
            standard_error=math.sqrt(_Q_ERROR**2 * variance + common),
        )
    return (
        Estimate(value=max(0.0, mean), standard_error=math.sqrt(variance + common)),
        v85,
    )

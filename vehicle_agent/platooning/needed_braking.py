"""Braking that the vehicle ahead makes necessary, and whether that one brakes.

A command given now takes effect after τ = `Braking.response_s`. Until then the own vehicle goes on
with the commands before it, the one ahead as it is known to. With both speeds and the room that
will be left then, the least constant deceleration b that ends before `AIM_M` is

    b = a + u² / 2 room              where both speeds meet before the vehicle ahead stands
    b = v² / 2(room + v_f² / 2a)     else

It is no more than the guaranteed one where the gap was at least `slipstream.spacing.least_gap_m`.

Who is heard tells its braking. Of who is not, sensing tells it: its speed has fallen by
`EVIDENT_MPS` more than it told. Then it is taken to brake as hard as its speeds allow for.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

from slipstream.spacing import GAP_ERROR_M, STANDING_M

AIM_M: Final = STANDING_M + GAP_ERROR_M
"""Gap that is left where braking is needed."""

EVIDENT_MPS: Final = 0.3
"""Three times what the own sensors measure a speed to."""

_JUDGED_NS: Final = 1_000_000_000
_LATE_NS: Final = 900_000_000
"""Brakes follow what they are commanded by 0.6 s at most, sensing and messages by 0.1 s each."""

_MISSED_SHARE: Final = 0.1
"""Of what is told: brakes may miss it by as much."""

_OLD_S: Final = 0.25
"""By as much older than what is sensed may be what was told, where messages are lost."""

_WITHIN_NS: Final = 300_000_000
_HOLDS_NS: Final = 600_000_000
_STANDS_MPS: Final = 1.0
_LEAST_ROOM_M: Final = 0.1
_LEAST_MPS2: Final = 0.05


@dataclass(frozen=True, slots=True)
class AheadMotion:
    """The vehicle directly ahead.

    Attributes:
        slowing_mps2: its deceleration as far as it is known; 0: none.
        trend_mps2: its acceleration until a command of now takes effect; None: by `slowing_mps2`.
        feed_mps2: acceleration that it has told for the coming interval, or its platoon's leader.
        bound_mps2: the most that it may brake with.
        leader_mps: speed of its platoon's leader; None: not heard, or it leads itself.
    """

    gap_m: float
    speed_mps: float
    slowing_mps2: float = 0.0
    feed_mps2: float = 0.0
    bound_mps2: float = 9.0
    leader_mps: float | None = None
    trend_mps2: float | None = None


def needed_mps2(
    ahead: AheadMotion,
    speed_mps: float,
    effective_mps: float,
    response_s: float,
    aim_m: float = AIM_M,
) -> float:
    """Least constant deceleration that is needed from the moment when it takes effect, m/s².

    Args:
        speed_mps: the own speed.
        effective_mps: the own one at that moment.
        response_s: τ.
        aim_m: gap that is left.
    """
    trend = -ahead.slowing_mps2 if ahead.trend_mps2 is None else ahead.trend_mps2
    moves_s = response_s if trend > -_LEAST_MPS2 else min(response_s, ahead.speed_mps / -trend)
    front_mps = max(0.0, ahead.speed_mps + trend * response_s)
    room_m = ahead.gap_m + ahead.speed_mps * moves_s + trend * moves_s**2 / 2
    room_m -= (speed_mps + effective_mps) / 2 * response_s
    return braking_mps2(effective_mps, front_mps, ahead.slowing_mps2, room_m - aim_m)


def braking_mps2(speed_mps: float, front_mps: float, front_mps2: float, room_m: float) -> float:
    """Least constant deceleration from now on by which a gap shrinks by no more than a room."""
    faster_mps = speed_mps - front_mps
    if faster_mps <= 0:
        return 0.0
    room_m = max(room_m, _LEAST_ROOM_M)
    if front_mps2 < _LEAST_MPS2:
        return faster_mps * faster_mps / (2 * room_m)
    if 2 * room_m / faster_mps < front_mps / front_mps2:
        return front_mps2 + faster_mps * faster_mps / (2 * room_m)
    return speed_mps * speed_mps / (2 * (room_m + front_mps * front_mps / (2 * front_mps2)))


class Evidence:
    """What the own sensors have seen of the braking of the vehicle ahead in the last 0.3 s, but
    since the sample before at least.
    """

    def __init__(self) -> None:
        self._track: str | None = None
        self._samples: deque[tuple[int, float, float]] = deque(maxlen=8)
        self._until_ns, self._told_mps2 = 0, 0.0

    def update(self, time_ns: int, track: str | None, ahead_mps: float, told_mps2: float) -> bool:
        """Take a sample; whether it brakes harder than it tells.

        Args:
            time_ns: of the sample.
            track: of the vehicle ahead; None: none is sensed.
            told_mps2: deceleration that it tells; 0: none, or it is silent.
        """
        samples = self._samples
        if track != self._track or (samples and time_ns < samples[-1][0]):
            self._track, self._until_ns = track, 0
            samples.clear()
        if track is None:
            return False
        if not samples or time_ns > samples[-1][0]:
            # What it told before explains a part of what its speed has fallen by since.
            told_mps = self._told_mps2 * (time_ns - samples[-1][0]) / 1e9 if samples else 0.0
            for number, (then_ns, mps, explained) in enumerate([*samples]):
                samples[number] = then_ns, mps, explained - told_mps
            samples.append((time_ns, ahead_mps, ahead_mps))
            while len(samples) > 2 and samples[0][0] < time_ns - _WITHIN_NS:
                samples.popleft()
        self._told_mps2 = told_mps2
        if max(explained for _, _, explained in samples) - ahead_mps > EVIDENT_MPS:
            self._until_ns = time_ns + _HOLDS_NS
        return time_ns < self._until_ns

    @property
    def span_mps2(self) -> tuple[float, float]:
        """Least and largest acceleration that its speeds and their errors allow for."""
        seconds = (self._samples[-1][0] - self._samples[0][0]) / 1e9 if self._samples else 0.0
        if seconds <= 0:
            return -math.inf, math.inf
        change_mps = self._samples[-1][1] - self._samples[0][1]
        return (change_mps - EVIDENT_MPS) / seconds, (change_mps + EVIDENT_MPS) / seconds


Verdict = Literal["braking", "speeding up", "promise"]
"""What of what a vehicle tells does not come, or is broken."""


class _Sample(NamedTuple):
    """Of the vehicle ahead; `planned_mps` and `measured_mps` are the sums of what it told of its
    accelerations until then.
    """

    time_ns: int
    speed_mps: float
    planned_mps: float = 0.0
    measured_mps: float = 0.0
    planned_mps2: float = 0.0
    measured_mps2: float = 0.0
    limit_mps2: float = math.inf


class Told:
    """Whether the vehicle directly ahead drives what it tells. Within a second, its speed as sensed
    has to change as what it told of a second that ends up to 0.9 s before, or between the least and
    the most of these, but for `EVIDENT_MPS` and what brakes and lost messages may miss.
    """

    def __init__(self) -> None:
        self._track: str | None = None
        self._samples: deque[_Sample] = deque(maxlen=64)

    def end(self) -> None:
        """Forget what was seen."""
        self._samples.clear()

    def update(
        self,
        time_ns: int,
        track: str,
        ahead_mps: float,
        planned_mps2: float,
        measured_mps2: float,
        limit_mps2: float | None,
    ) -> Verdict | None:
        """Take a sample; None: nothing speaks against the vehicle ahead.

        Args:
            time_ns: of the sample.
            track: of the vehicle ahead.
            ahead_mps: its speed.
            planned_mps2: acceleration that it tells for now.
            measured_mps2: that it tells of its last one.
            limit_mps2: that it promises; None: nothing.
        """
        samples = self._samples
        # A vehicle that stands may tell any braking.
        stands = ahead_mps < _STANDS_MPS
        if stands or track != self._track or (samples and time_ns < samples[-1].time_ns):
            self._track = track
            samples.clear()
        if stands or (samples and time_ns == samples[-1].time_ns):
            return None
        before = samples[-1] if samples else _Sample(time_ns, ahead_mps)
        seconds = (time_ns - before.time_ns) / 1e9
        samples.append(
            _Sample(
                time_ns,
                ahead_mps,
                before.planned_mps + before.planned_mps2 * seconds,
                before.measured_mps + before.measured_mps2 * seconds,
                planned_mps2,
                measured_mps2,
                math.inf if limit_mps2 is None else limit_mps2,
            )
        )
        while samples[0].time_ns < time_ns - 2 * _JUDGED_NS - _LATE_NS:
            samples.popleft()
        return self._verdict()

    def _verdict(self) -> Verdict | None:
        samples = [*self._samples]
        newest, times = samples[-1], [one.time_ns for one in samples]
        if times[0] > newest.time_ns - _JUDGED_NS - _LATE_NS:
            return None
        ends = samples[bisect_left(times, newest.time_ns - _LATE_NS) :]
        begins = [samples[bisect_right(times, end.time_ns - _JUDGED_NS) - 1] for end in ends]
        pairs = [*zip(ends, begins, strict=True)]
        within = samples[bisect_right(times, newest.time_ns - _JUDGED_NS) - 1 :]
        change_mps = newest.speed_mps - within[0].speed_mps
        planned = [end.planned_mps - begin.planned_mps for end, begin in pairs]
        measured = [end.measured_mps - begin.measured_mps for end, begin in pairs]
        error = _error_mps(planned, [one.planned_mps2 for one in within])
        limit_mps = max(one.limit_mps2 for one in within) * _JUDGED_NS / 1e9
        if change_mps < min(0.0, *planned, -limit_mps) - error:
            return "promise"
        if change_mps > max(planned) + error:
            return "braking"
        if change_mps > max(measured) + _error_mps(measured, [one.measured_mps2 for one in within]):
            return "braking"
        return "speeding up" if 0 < min(planned) - error > change_mps else None


def _error_mps(changes_mps: list[float], told_mps2: list[float]) -> float:
    """By how much a change of speed may miss what was told of it."""
    missed = _MISSED_SHARE * max(abs(change) for change in changes_mps)
    return EVIDENT_MPS + missed + _OLD_S * max(abs(one) for one in told_mps2)

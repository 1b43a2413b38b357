"""What the brakes do of what is commanded, against what is declared of them.

A braking is watched from a calm drive on until it is released. From the same speed a brake that
is as slow and weak as declared slows down by

    D = ∫ a_s dt,   a_s' = ((1 − error) a_cmd(t − dead (1 + tolerance)) − a_s) / lag (1 + tolerance)

and what the vehicle slowed down by less than that is what its brakes lack. Full braking is not
commanded in ordinary drives: a brake that is weak only there is not seen.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Final

from slipstream.braking import Braking

_BRAKINGS: Final = 10
_LEAST_BRAKINGS: Final = 3
_LACK_MPS: Final = 0.12
"""Mean of what is lacking, of three brakings and more: three times what sensed speeds, each to 0.1
m/s, make of it."""

_LEAST_MPS: Final = 0.8
_CALM_MPS2: Final = 0.3
_BRAKES_MPS2: Final = 0.6
_RELEASED_MPS2: Final = 0.2
_CALM_NS: Final = 1_000_000_000
_LONGEST_NS: Final = 4_000_000_000
_STANDING_MPS: Final = 1.0
_SUBSTEP_S: Final = 0.02


class BrakeEstimate:
    """Of one vehicle, by its commanded accelerations and its sensed speeds.

    Attributes:
        share: of the deceleration that is declared, what has come in the last brakings, within [0,
            1); None: as much as declared, or too few brakings were watched.
        braking: as declared; or weaker, and later by as much as would explain the lack too.
    """

    def __init__(self, declared: Braking) -> None:
        self.share: float | None = None
        self.braking = self._declared = declared
        self._dead_ns = round(declared.dead_s * (1 + declared.tolerance) * 1e9)
        self._lag_s = declared.lag_s * (1 + declared.tolerance)
        self._gain = 1 - declared.error
        self._commands: deque[tuple[int, float]] = deque(maxlen=64)
        self._calm_ns: int | None = None
        self._sensed_ns = 0
        self._slow_mps2 = 0.0
        self._braking: _Braking | None = None
        self._brakings: deque[tuple[float, float, float]] = deque(maxlen=_BRAKINGS)

    def update(
        self, now_ns: int, sensed_ns: int, speed_mps: float, commanded_mps2: float | None
    ) -> None:
        """One interval.

        Args:
            sensed_ns: time of the sensed speed.
            commanded_mps2: from `now_ns` on; None: nothing is commanded, the driver drives.
        """
        if sensed_ns > self._sensed_ns:
            self._model(sensed_ns)
            self._watch(sensed_ns, speed_mps)
        if commanded_mps2 is None:
            self._commands.clear()
            self._calm_ns = self._braking = None
            self._slow_mps2 = 0.0
            return
        self._commands.append((now_ns, commanded_mps2))
        if commanded_mps2 <= -_BRAKES_MPS2:
            calm = self._calm_ns is not None and now_ns - self._calm_ns >= _CALM_NS
            if self._braking is None and calm and sensed_ns <= now_ns:
                self._braking = _Braking(now_ns, speed_mps)
            self._calm_ns = None
        elif commanded_mps2 > _CALM_MPS2:
            self._calm_ns = None
        elif commanded_mps2 >= -_CALM_MPS2 and self._calm_ns is None:
            self._calm_ns = now_ns
        if self._braking is not None:
            self._braking.hardest_mps2 = max(self._braking.hardest_mps2, -commanded_mps2)
            if -commanded_mps2 < self._braking.hardest_mps2 - _RELEASED_MPS2:
                self._end()

    def _model(self, until_ns: int) -> None:
        """The slow brake's acceleration and speed, until the time of a sensed speed."""
        from_ns, self._sensed_ns = self._sensed_ns, until_ns
        if not self._commands or until_ns - from_ns > _CALM_NS:
            self._braking = None
            return
        count = math.ceil((until_ns - from_ns) / 1e9 / _SUBSTEP_S - 1e-6)
        step_ns = (until_ns - from_ns) / count
        change = 1.0
        if self._lag_s > 0:
            change = 1 - math.exp(-step_ns / 1e9 / self._lag_s)
        commands, number = [*self._commands], 0
        for step in range(count):
            at_ns = from_ns + (step + 0.5) * step_ns - self._dead_ns
            while number + 1 < len(commands) and commands[number + 1][0] <= at_ns:
                number += 1
            target = commands[number][1]
            target *= self._gain if target < 0 else 1.0
            self._slow_mps2 += (target - self._slow_mps2) * change
            if self._braking is not None:
                self._braking.slow_mps -= self._slow_mps2 * step_ns / 1e9

    def _watch(self, sensed_ns: int, speed_mps: float) -> None:
        braking = self._braking
        if braking is None:
            return
        braking.driven_mps = braking.began_mps - speed_mps
        if speed_mps < _STANDING_MPS:
            self._braking = None
        elif sensed_ns - braking.began_ns > _LONGEST_NS:
            self._end()

    def _end(self) -> None:
        braking, self._braking = self._braking, None
        if braking is None or braking.slow_mps < _LEAST_MPS:
            return
        self._brakings.append((braking.slow_mps, braking.driven_mps, braking.hardest_mps2))
        self.share, self.braking = self._lacking_share(), self._declared
        if self.share is not None:
            late_s = sum((slow - driven) / hardest for slow, driven, hardest in self._brakings)
            self.braking = replace(
                self._declared,
                guaranteed_mps2=self._declared.guaranteed_mps2 * max(self.share, 0.1),
                dead_s=self._declared.dead_s + late_s / len(self._brakings),
            )

    def _lacking_share(self) -> float | None:
        count = len(self._brakings)
        if count < _LEAST_BRAKINGS:
            return None
        declared = sum(slow for slow, _, _ in self._brakings)
        lacks = declared - sum(driven for _, driven, _ in self._brakings)
        return max(0.0, 1 - lacks / declared) if lacks > _LACK_MPS * count else None


class _Braking:
    """One braking, from its first command on: what the slow brake and the vehicle slow down by."""

    def __init__(self, began_ns: int, began_mps: float) -> None:
        self.began_ns, self.began_mps = began_ns, began_mps
        self.slow_mps = self.driven_mps = self.hardest_mps2 = 0.0

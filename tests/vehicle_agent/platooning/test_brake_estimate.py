"""Brakes that do less than is declared of them are noticed; those that do as declared never are."""

from __future__ import annotations

import math
import random
from collections import deque

import pytest

from slipstream.braking import BRAKING, Braking, BrakingClass
from vehicle_agent.platooning.brake_estimate import BrakeEstimate

_STEP_S, _SUBSTEPS = 0.1, 5
_REAL: tuple[BrakingClass, ...] = ("brake_by_wire", "car", "van", "truck")


class Driven:
    """A vehicle that is told to brake now and then, and the estimate of its brakes.

    Args:
        share: of a commanded deceleration that comes.
        slower: its dead time and time constant, over the declared ones.
    """

    def __init__(self, declared: Braking, share: float, slower: float, seed: int = 0) -> None:
        self.estimate = BrakeEstimate(declared)
        self._rng = random.Random(seed)
        self._share, self._lag_s = share, declared.lag_s * slower
        waiting = round(declared.dead_s * slower / _STEP_S * _SUBSTEPS)
        self._sent = deque([0.0] * waiting)
        self._speed_mps = self._now_ns = 0
        self._acceleration_mps2 = 0.0

    def brake(self, mps2: float, seconds: float) -> None:
        """Drive calmly at some speed, then brake, and be released."""
        self._speed_mps = self._rng.uniform(15.0, 25.0)
        self._drive([self._rng.uniform(-0.2, 0.2) for _ in range(20)])
        self._drive([-mps2 * self._rng.uniform(0.95, 1.0)] * round(seconds / _STEP_S))
        self._drive([0.0] * 20)

    def _drive(self, commands: list[float]) -> None:
        for command in commands:
            sensed = self._speed_mps + self._rng.gauss(0.0, 0.05)
            self.estimate.update(self._now_ns, self._now_ns, sensed, command)
            for _ in range(_SUBSTEPS):
                self._sent.append(command)
                wanted = self._sent.popleft()
                wanted *= self._share if wanted < 0 else 1.0
                dt = _STEP_S / _SUBSTEPS
                change = 1 - math.exp(-dt / self._lag_s) if self._lag_s > 0 else 1.0
                self._acceleration_mps2 += (wanted - self._acceleration_mps2) * change
                self._speed_mps += self._acceleration_mps2 * dt
            self._now_ns += round(_STEP_S * 1e9)


@pytest.mark.parametrize("kind", _REAL)
@pytest.mark.parametrize("road", ["dry", "wet"])
def test_brakes_within_their_tolerance_are_never_called_weak(kind: BrakingClass, road: str) -> None:
    """At its worst corner too, with sensed speeds that are wrong by 0.05 m/s."""
    declared = BRAKING[kind].on(road)  # type: ignore[arg-type]
    for seed in range(2):
        slower = 1 + declared.tolerance
        driven = Driven(declared, 1 - declared.error, slower, seed)
        rng = random.Random(seed)
        for _ in range(20):
            driven.brake(rng.uniform(0.7, 2.5), rng.uniform(1.0, 4.0))
            assert driven.estimate.share is None
        assert driven.estimate.braking is declared


@pytest.mark.parametrize("kind", _REAL)
def test_brakes_that_do_30_percent_less_are_noticed_within_ten_brakings(kind: BrakingClass) -> None:
    """Of comfortable ones; then less is counted on. Ten good ones end it."""
    declared = BRAKING[kind].on("dry")
    for seed in range(2):
        driven, rng = Driven(declared, 0.7, 1.0, seed), random.Random(seed)
        for _ in range(10):
            driven.brake(rng.uniform(1.0, 2.0), rng.uniform(1.5, 3.0))
        share = driven.estimate.share
        assert share is not None
        assert share == pytest.approx(0.7 / (1 - declared.error), abs=0.12)
        weak = driven.estimate.braking
        assert weak.guaranteed_mps2 < 0.9 * declared.guaranteed_mps2
        assert weak.response_s > declared.response_s
        driven._share = 1.0
        for _ in range(10):
            driven.brake(1.5, 2.0)
        assert driven.estimate.share is None


@pytest.mark.parametrize("kind", ["car", "van", "truck"])
def test_brakes_that_come_30_percent_later_are_noticed_too(kind: BrakingClass) -> None:
    """Than the latest that is declared: 0.14 s of a car's."""
    declared = BRAKING[kind].on("dry")
    driven = Driven(declared, 1 - declared.error, 1.3 * (1 + declared.tolerance))
    for _ in range(10):
        driven.brake(1.8, 2.0)
    assert driven.estimate.share is not None
    assert driven.estimate.braking.response_s > declared.response_s + 0.1


def test_what_no_brake_was_told_is_no_evidence() -> None:
    """A driver who brakes less, a braking that began before, or one that ends in a stop."""
    declared = BRAKING["car"].on("dry")
    estimate = BrakeEstimate(declared)
    for number in range(600):
        now_ns = number * 100_000_000
        braking = number % 60 > 30
        estimate.update(now_ns, now_ns, 20.0, None if number % 60 == 35 else -1.5 * braking)
        assert estimate.share is None

"""Brakes and drives of simulated vehicles: what becomes of a command, and what sensors make of it.

SUMO sets a speed at once. A vehicle that is not ideal comes to it by its dead time, and a
first-order lag after it, integrated within SUMO's step.
"""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import dataclass
from typing import Final, Self

from slipstream.braking import BRAKING, HARDEST_MPS2, Braking, Road
from slipstream.messages import VehicleSensing
from slipstream.vehicle_types import VehicleType

SUBSTEP_S: Final = 0.02
_FASTEST_MPS2: Final = 1.8
"""As drivers accelerate; SUMO lets no vehicle of the fleet do more."""


@dataclass(frozen=True)
class Reality:
    """What of vehicles, sensors and messages is not ideal in a simulated day.

    Attributes:
        braking: of every vehicle of the fleet, on the day's road.
        others_mps2: the most that any vehicle brakes with on it.
        seed: of all that is drawn.
        gap_noise_m: standard deviation of a sensed gap; None: 0.03, and 0 of ideal vehicles.
        speed_noise_mps: of the sensed speed of the vehicle ahead; None: 0.05, likewise.
        loss: share of the copies of messages between vehicles that are lost.
        latency_s: of such a message.
    """

    braking: Braking
    others_mps2: float
    seed: int = 0
    gap_noise_m: float | None = None
    speed_noise_mps: float | None = None
    loss: float = 0.0
    latency_s: float = 0.0

    @classmethod
    def of_day(cls, kind: VehicleType, road: Road, *, ideal: bool, seed: int) -> Self:
        """Of vehicles of a type on a road; or with the brakes of the paper's ideal vehicle."""
        if ideal:
            braking = BRAKING["ideal"].on(road)
            return cls(braking, braking.greatest_mps2, seed)
        return cls(kind.brakes.on(road), HARDEST_MPS2[road], seed)

    @property
    def ideal(self) -> bool:
        """Whether vehicles do at once what they are told."""
        return self.braking.response_s <= 0

    def vehicle(self, name: str) -> RealVehicle | None:
        """A vehicle, drawn by the seed; None: it is ideal."""
        if self.ideal:
            return None
        rng = random.Random(f"{self.seed}/{name}")
        gap = 0.03 if self.gap_noise_m is None else self.gap_noise_m
        speed = 0.05 if self.speed_noise_mps is None else self.speed_noise_mps
        return RealVehicle(Brakes.drawn(self.braking, rng), self.braking, rng, gap, speed)


@dataclass
class RealVehicle:
    """A vehicle that is not ideal.

    Attributes:
        brakes: as they are.
        braking: as they are declared.
    """

    brakes: Brakes
    braking: Braking
    rng: random.Random
    gap_noise_m: float
    speed_noise_mps: float

    def sensed(self, true: VehicleSensing, ahead_mps2: float) -> VehicleSensing:
        """What its agent is told: the vehicle ahead as it was when the sensor saw it, with noise,
        and the own acceleration.

        Args:
            ahead_mps2: acceleration of the vehicle ahead.
        """
        changed: dict[str, object] = {"acceleration_mps2": self.brakes.acceleration_mps2}
        ahead, age_s = true.ahead, self.braking.sensing_s
        if ahead is not None:
            gap_m = ahead.gap_m - (ahead.speed_mps - true.speed_mps) * age_s
            speed_mps = ahead.speed_mps - ahead_mps2 * age_s
            changed["ahead"] = ahead.model_copy(
                update={
                    "gap_m": gap_m + self.rng.gauss(0.0, self.gap_noise_m),
                    "speed_mps": max(0.0, speed_mps + self.rng.gauss(0.0, self.speed_noise_mps)),
                }
            )
        return true.model_copy(update=changed)


class Brakes:
    """Brakes and drive of one vehicle, within what is declared of them.

    Args:
        dead_s: from a command to the first change.
        lag_s: time constant of it.
        share: of a commanded deceleration that comes.
        full_mps2: deceleration of full braking.

    Attributes:
        acceleration_mps2: at present.
    """

    def __init__(self, dead_s: float, lag_s: float, share: float, full_mps2: float) -> None:
        self.dead_s, self.lag_s, self.share, self.full_mps2 = dead_s, lag_s, share, full_mps2
        self.acceleration_mps2 = 0.0
        self._sent: deque[float] = deque()

    @classmethod
    def drawn(cls, braking: Braking, rng: random.Random, corner: float = 0.0) -> Self:
        """Nominal values and their tolerance.

        Args:
            corner: share of the values that lie at an end of it.
        """

        def at_end() -> bool:
            return corner > 0 and rng.random() < corner

        def off() -> float:
            return rng.choice((-1.0, 1.0)) if at_end() else rng.uniform(-1, 1)

        span_mps2 = braking.greatest_mps2 - braking.guaranteed_mps2
        return cls(
            braking.dead_s * (1 + braking.tolerance * off()),
            braking.lag_s * (1 + braking.tolerance * off()),
            1 + braking.error * off(),
            braking.guaranteed_mps2 + span_mps2 * (0.0 if at_end() else rng.random()),
        )

    def drive(self, speed_mps: float, wanted_mps2: float, step_s: float) -> float:
        """The speed after a step in which an acceleration is commanded."""
        count = max(1, math.ceil(step_s / SUBSTEP_S - 1e-9))
        dt = step_s / count
        waiting = round(self.dead_s / dt)
        change = 1 - math.exp(-dt / self.lag_s) if self.lag_s > 0 else 1.0
        while len(self._sent) < waiting:
            self._sent.appendleft(self.acceleration_mps2)
        for _ in range(count):
            self._sent.append(wanted_mps2)
            while len(self._sent) > waiting:
                target = self._sent.popleft()
            if target < 0:
                target = max(target * self.share, -self.full_mps2)
            target = min(target, _FASTEST_MPS2)
            self.acceleration_mps2 += (target - self.acceleration_mps2) * change
            speed_mps = max(0.0, speed_mps + self.acceleration_mps2 * dt)
            if speed_mps == 0.0:
                self.acceleration_mps2 = max(0.0, self.acceleration_mps2)
        return speed_mps

    def took(self, acceleration_mps2: float) -> None:
        """It was driven otherwise, as by its driver."""
        self.acceleration_mps2 = acceleration_mps2
        self._sent.clear()

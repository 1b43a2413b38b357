"""One vehicle of a platoon: its actuators, its own emergency brake, and its agent's platooning."""

from __future__ import annotations

import random
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from slipstream.braking import Braking
from slipstream.energy.traction import PAPER_CAR
from slipstream.messages import PlannedSegment
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning import COMFORTABLE_MPS2, OwnVehicle, Platooning
from vehicle_agent.platooning.needed_braking import AheadMotion, needed_mps2

LENGTH_M: Final = 4.6
STEP_S: Final = 0.02
INTERVAL_S: Final = 0.1
VALID_S: Final = 0.25
_OWN_SENSING_S: Final = 0.1
_ACCELERATION_MPS2: Final = 1.8


def road(limit_mps: float) -> Leg:
    """Ten kilometres of a road without signals, all gates open."""
    names = "abcdefghij"
    return Leg(
        1,
        0,
        tuple(
            PlannedSegment(
                segment=name,
                entry_ns=0,
                exit_ns=0,
                speed_mps=limit_mps,
                platoon="p",
                place=1,
                gap_m=None,
                leg=0,
                length_m=1000.0,
                speed_limit_mps=limit_mps,
                lanes=1,
            )
            for name in names
        ),
    )


@dataclass(frozen=True)
class Body:
    """What a vehicle really does, within what is declared of it.

    Attributes:
        dead_s: of its brake and drive.
        lag_s: likewise.
        share: of a commanded deceleration that comes.
        full_mps2: deceleration of full braking.
    """

    dead_s: float
    lag_s: float
    share: float
    full_mps2: float

    @classmethod
    def drawn(cls, braking: Braking, rng: random.Random, corner: float) -> Body:
        """Within the tolerances; a share `corner` of the values lies at one of their ends."""

        def within(tolerance: float) -> float:
            end = rng.choice((-1.0, 1.0))
            return 1 + tolerance * (end if rng.random() < corner else rng.uniform(-1, 1))

        span = braking.greatest_mps2 - braking.guaranteed_mps2
        return cls(
            braking.dead_s * within(braking.tolerance),
            braking.lag_s * within(braking.tolerance),
            within(braking.error),
            braking.guaranteed_mps2 + span * (0.0 if rng.random() < corner else rng.random()),
        )


@dataclass
class Vehicle:
    """A vehicle on the road.

    Attributes:
        place_m: of its front.
        advised: acceleration, and until when it holds; None: its driver drives it.
    """

    name: str
    body: Body
    braking: Braking
    leg: Leg
    place_m: float
    speed_mps: float
    others_mps2: float
    phase_s: float
    agent_dies_s: float = float("inf")
    acceleration_mps2: float = 0.0
    mode: str = "alone"
    advised: tuple[float, float] | None = None
    hardest_mps2: float = 0.0
    platooning: Platooning = field(init=False)
    _pipeline: deque[float] = field(init=False)
    _past: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=16))

    def __post_init__(self) -> None:
        own = OwnVehicle(PAPER_CAR, self.braking, self.others_mps2, INTERVAL_S, 1.0, "paper")
        self.platooning = Platooning(self.name, LENGTH_M, own)
        self._pipeline = deque([0.0] * max(1, round(self.body.dead_s / STEP_S)))

    def state(self, place_m: float, speed_mps: float, acceleration_mps2: float) -> VehicleState:
        """Where it is on its leg."""
        number = bisect_right(self.leg.begins_m, place_m) - 1
        front_m = place_m - self.leg.begins_m[number]
        return VehicleState(
            self.leg.path[number], number, False, 0, front_m, speed_mps, acceleration_mps2
        )

    def move(self, now_s: float, gap_m: float, ahead_mps: float) -> None:
        """One step of its body: the agent's command, or its own control where none holds."""
        wanted = self._own_control(now_s, gap_m, ahead_mps)
        if self.body.dead_s >= STEP_S / 2:
            self._pipeline.append(wanted)
            wanted = self._pipeline.popleft()
        if wanted < 0:
            wanted = max(wanted * self.body.share, -self.body.full_mps2)
        if self.body.lag_s > STEP_S:
            self.acceleration_mps2 += (wanted - self.acceleration_mps2) * STEP_S / self.body.lag_s
        else:
            self.acceleration_mps2 = wanted
        before = self.speed_mps
        self.speed_mps = max(0.0, before + self.acceleration_mps2 * STEP_S)
        if self.speed_mps == 0.0:
            self.acceleration_mps2 = max(0.0, self.acceleration_mps2)
        self.place_m += (before + self.speed_mps) / 2 * STEP_S
        self.hardest_mps2 = min(self.hardest_mps2, self.acceleration_mps2)

    def _own_control(self, now_s: float, gap_m: float, ahead_mps: float) -> float:
        if self.advised is None:
            return 0.0
        mps2, until_s = self.advised
        self._past.append((gap_m, ahead_mps))
        if now_s <= until_s:
            return mps2
        # No advice: the stated deceleration, and its own emergency brake.
        late = min(len(self._past), round(_OWN_SENSING_S / STEP_S) + 1)
        gap_m, ahead_mps = self._past[-late]
        before_mps = self._past[-min(len(self._past), late + 10)][1]
        slowing = max(0.0, (before_mps - ahead_mps) / (10 * STEP_S))
        gap_m -= max(0.0, self.speed_mps - ahead_mps) * _OWN_SENSING_S
        ahead = AheadMotion(gap_m, ahead_mps, slowing)
        then_mps = max(0.0, self.speed_mps + self.acceleration_mps2 * self.braking.nominal_s)
        needed = needed_mps2(ahead, self.speed_mps, then_mps, self.braking.response_s)
        return -max(COMFORTABLE_MPS2, min(needed, self.braking.guaranteed_mps2))

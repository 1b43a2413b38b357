"""One vehicle of a platoon: its body, its own emergency brake, and its agent's platooning."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from slipstream.braking import Braking
from slipstream.energy.traction import PAPER_CAR
from slipstream.messages import PlannedSegment, SensedVehicle, VehicleSensing
from slipstream_lab.simulation.fleet.brakes import SUBSTEP_S, Brakes
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning import (
    AIM_M,
    COMFORTABLE_MPS2,
    IDM,
    AheadMotion,
    Own,
    OwnVehicle,
    Platooning,
    PlatoonStep,
    needed_mps2,
)

LENGTH_M: Final = 4.6
STEP_S: Final = SUBSTEP_S
INTERVAL_S: Final = 0.1
_VALID_S: Final = 0.25
_OWN_SENSING_S: Final = 0.1
_IMMINENT_SHARE: Final = 0.6
"""Of full braking: from there on its own emergency brake overrules advice."""

_MORE: Final = 1.1
"""Of the braking that is needed: what its own emergency brake does."""

_STANDING_GAP_M: Final = 1.0


def road(limit_mps: float, segment_m: float = 1000.0) -> Leg:
    """Ten segments of a road without signals."""
    segments = [
        PlannedSegment(
            segment=name,
            entry_ns=0,
            exit_ns=0,
            speed_mps=limit_mps,
            platoon="p",
            place=1,
            gap_m=None,
            leg=0,
            length_m=segment_m,
            speed_limit_mps=limit_mps,
            lanes=1,
        )
        for name in "abcdefghij"
    ]
    return Leg(1, 0, tuple(segments))


@dataclass
class Vehicle:
    """A vehicle on the road, with its agent.

    Attributes:
        braking: as declared.
        place_m: of its front.
        phase_s: of its agent's steps within their interval.
        agent_ends_s: when its agent dies.
        hardest_mps2: lowest acceleration so far.
        was_close: whether it has followed; before, it drives on behind the one ahead.
    """

    name: str
    brakes: Brakes
    braking: Braking
    leg: Leg
    place_m: float
    speed_mps: float
    others_mps2: float
    phase_s: float
    agent_ends_s: float = float("inf")
    hardest_mps2: float = 0.0
    last: PlatoonStep | None = None
    was_close: bool = False
    platooning: Platooning = field(init=False)
    _until_s: float = 0.0
    _seen: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=16))

    def __post_init__(self) -> None:
        own = OwnVehicle(PAPER_CAR, self.braking, self.others_mps2, INTERVAL_S, 1.0, "paper")
        self.platooning = Platooning(self.name, LENGTH_M, own)

    @property
    def acceleration_mps2(self) -> float:
        """At present."""
        return self.brakes.acceleration_mps2

    @property
    def mode(self) -> str:
        """As its agent said last."""
        return "alone" if self.last is None else self.last.mode

    def state(self) -> VehicleState:
        """Where it is on its leg."""
        number = bisect_right(self.leg.begins_m, self.place_m) - 1
        front_m = self.place_m - self.leg.begins_m[number]
        return VehicleState(
            *(self.leg.path[number], number, False, 0, front_m),
            *(self.speed_mps, self.acceleration_mps2),
        )

    def sensing(
        self, now_ns: int, ahead: SensedVehicle | None, behind: SensedVehicle | None
    ) -> VehicleSensing:
        """What it measures of itself, and of others as given."""
        state = self.state()
        return VehicleSensing(
            vehicle=self.name,
            time_ns=now_ns,
            on_road=True,
            segment=state.segment,
            crossing=False,
            lane=0,
            front_m=state.front_m,
            speed_mps=self.speed_mps,
            acceleration_mps2=self.acceleration_mps2,
            driven_m=0.0,
            ahead=ahead,
            behind=behind,
        )

    def take(self, step: PlatoonStep, now_s: float) -> None:
        """Its agent's advice."""
        self.last, self._until_s = step, now_s + _VALID_S
        self.was_close |= step.mode != "alone"

    def move(self, now_s: float, gap_m: float, ahead_mps: float) -> None:
        """One step, by its agent's advice or its own control."""
        self._seen.append((gap_m, ahead_mps))
        before = self.speed_mps
        self.speed_mps = self.brakes.drive(before, self._wanted_mps2(now_s), STEP_S)
        self.place_m += (before + self.speed_mps) / 2 * STEP_S
        self.hardest_mps2 = min(self.hardest_mps2, self.acceleration_mps2)

    def _wanted_mps2(self, now_s: float) -> float:
        step = self.last
        if step is None:
            return 0.0
        if now_s <= self._until_s and step.acceleration_mps2 is not None:
            emergency = self._emergency_mps2()
            imminent = emergency > _IMMINENT_SHARE * self.braking.guaranteed_mps2
            return min(step.acceleration_mps2, -emergency) if imminent else step.acceleration_mps2
        if step.mode == "alone":
            return self._driver_mps2() if self.name == "v0" or self.was_close else 0.0
        # No advice any more: the stated deceleration, and its own emergency brake.
        return -max(COMFORTABLE_MPS2, self._emergency_mps2())

    def _emergency_mps2(self) -> float:
        """Of its own emergency brake, which senses ten times a second."""
        seen = self._seen
        late = min(len(seen), round(_OWN_SENSING_S / STEP_S) + 1)
        gap_m, ahead_mps = seen[-late]
        span = min(len(seen) - late, 10)
        slowing = max(0.0, seen[-late - span][1] - ahead_mps) / max(span * STEP_S, STEP_S)
        if gap_m < AIM_M and self.speed_mps > ahead_mps:
            return self.braking.guaranteed_mps2
        then_mps = max(0.0, self.speed_mps + self.acceleration_mps2 * self.braking.nominal_s)
        gap_m -= max(0.0, self.speed_mps - ahead_mps) * _OWN_SENSING_S
        needed = needed_mps2(
            AheadMotion(gap_m, ahead_mps, slowing),
            *(self.speed_mps, then_mps, self.braking.response_s),
        )
        # Its brake may do less than it is told, and what is just enough is late in the end.
        margin = _MORE / (1 - self.braking.error)
        return min(margin * needed, self.braking.guaranteed_mps2)

    def _driver_mps2(self) -> float:
        """A driver who has the vehicle alone: follows as drivers do, and brakes in an emergency."""
        gap_m, ahead_mps = self._seen[-1]
        if gap_m < _STANDING_GAP_M and self.speed_mps >= ahead_mps:
            return -COMFORTABLE_MPS2
        wish_mps = self.leg.limits_mps[0]
        own = Own(self.speed_mps, wish_mps, wish_mps, 2.0, INTERVAL_S, PAPER_CAR, self.braking)
        follows = IDM.acceleration_to_mps2(own, gap_m, ahead_mps)
        return max(-self.braking.guaranteed_mps2, min(follows, -self._emergency_mps2()))

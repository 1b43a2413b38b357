"""Speed advice for one vehicle on its leg: the largest speed for each coming interval."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from slipstream.energy.drive import DrivingStyle, plan_drive
from slipstream.energy.traction import PAPER_CAR, VehicleParameters
from slipstream.messages import DrivingAdvice, SensedVehicle
from vehicle_agent.free_drive import free_drive_s
from vehicle_agent.leg import Leg, StopLine, VehicleState
from vehicle_agent.signals import HORIZON_M, SignalTimings
from vehicle_agent.speed.approach import MIN_MPS, arrival_speed_mps, choose_arrival_s
from vehicle_agent.speed.coasting import CoastingModel, braked_mps
from vehicle_agent.speed.envelope import HARD_MPS2
from vehicle_agent.speed.lead_vehicle import is_closing, queue_length
from vehicle_agent.speed.value_of_time import leg_value_of_time_w

_BRAKING_MPS2: Final = 1.5
"""Comfortable deceleration before turns and stops."""
_CLOSING_MPS2: Final = 0.3
"""Deceleration behind a slower vehicle."""
_SLOWING_MPS2: Final = 1.5
"""Deceleration towards the speed for a signal that is far off."""
_ACCELERATION_MPS2: Final = 1.3
"""In predictions."""


@dataclass
class _Drive:
    """A leg that is driven with speed advice; `track`: of the vehicle ahead, with its speed."""

    leg: Leg
    advice: DrivingAdvice
    value_of_time_w: float
    budget_s: float
    spent_s: float = 0.0
    track: str | None = None
    track_mps: float = 0.0


class SpeedAdvisor:
    """Speeds for one vehicle, where its plan has eco-approach, coasting, or both."""

    def __init__(
        self,
        timings: SignalTimings,
        interval_s: float,
        vehicle: VehicleParameters = PAPER_CAR,
    ) -> None:
        self._timings = timings
        self._interval_s = interval_s
        self._vehicle = vehicle
        self._coasting = CoastingModel.of(vehicle)
        self._drive: _Drive | None = None

    def begin(self, leg: Leg, advice: DrivingAdvice) -> None:
        """The vehicle begins a leg, or is given another way on it.

        On another way the time that coasting may take and its price stay those of the leg, and what
        has been spent counts: a plan that comes in the middle of it has only the rest of its road.
        """
        known = self._drive
        if not (advice.eco_approach or advice.coasting_budget > 0):
            self._drive = None
            return
        if known is not None:
            self._drive = replace(known, leg=leg, advice=advice)
            return
        free_s = plan_drive(leg.lengths_m, leg.limits_mps, DrivingStyle()).duration_s
        budget_s = advice.coasting_budget * free_s
        value_of_time_w = leg_value_of_time_w(
            leg, budget_s, self._coasting, _BRAKING_MPS2, self._vehicle
        )
        self._drive = _Drive(leg, advice, value_of_time_w, budget_s)

    def end(self) -> None:
        """The vehicle has ended its leg."""
        self._drive = None

    def cap_mps(
        self, now_s: float, state: VehicleState, ahead: SensedVehicle | None, tail_m: float = 0.0
    ) -> float | None:
        """Largest speed after the coming interval, m/s; None: no advice. `tail_m` is from the own
        front to the rear of the last vehicle that goes with it.
        """
        drive = self._drive
        if drive is None:
            return None
        place_m = drive.leg.place_m(state)
        line = None if state.crossing else self._line(drive.leg, place_m)
        if line is not None and self._is_committed(line, now_s, state, place_m):
            return None
        cap = math.inf
        if drive.advice.eco_approach and line is not None:
            cap = self._for_signal(drive.leg, line, now_s, state, place_m, tail_m, ahead)
        if drive.spent_s < drive.budget_s and state.speed_mps > 0:
            cap = min(cap, self._coast_speed(drive, state, place_m))
        if ahead is not None:
            steady = ahead.track == drive.track and ahead.speed_mps <= drive.track_mps + 0.05
            drive.track, drive.track_mps = ahead.track, ahead.speed_mps
            if steady and is_closing(ahead, state.speed_mps, _CLOSING_MPS2):
                cap = min(cap, self._coasting.after(state.speed_mps, self._interval_s))
        return None if cap == math.inf else cap

    def _line(self, leg: Leg, place_m: float) -> StopLine | None:
        """The next stop line, if it is near."""
        line = leg.next_line(place_m)
        return None if line is None or line.at_m - place_m > HORIZON_M else line

    def _is_committed(
        self, line: StopLine, now_s: float, state: VehicleState, place_m: float
    ) -> bool:
        """Whether the light ahead is no longer green and the vehicle too near to stop for it. It
        may go on while it is yellow; advice to slow down would bring it to the line when it is red.
        """
        speed = state.speed_mps
        stopping_m = speed**2 / (2 * HARD_MPS2) + speed * self._interval_s
        if line.at_m - place_m > stopping_m:
            return False
        greens = self._timings.upcoming(line.intersection, _group(line, state), now_s)
        return not greens or greens[0].begin_s > now_s

    def _coast_speed(self, drive: _Drive, state: VehicleState, place_m: float) -> float:
        """The speed of rolling, if it is time to roll towards a place where speed must be lower."""
        speed, braking = state.speed_mps, _BRAKING_MPS2
        limit = drive.leg.limits_mps[state.number]
        for slow in drive.leg.slow_ahead(place_m):
            ahead_m = slow.at_m - place_m
            if ahead_m > HORIZON_M:
                break
            if ahead_m <= self._coasting.approach_m(
                speed, slow.speed_mps, drive.value_of_time_w, braking
            ):
                unhindered = min(limit, braked_mps(ahead_m, slow.speed_mps, braking))
                if unhindered > speed:
                    drive.spent_s += self._interval_s * (1 - speed / unhindered)
                return max(slow.speed_mps, self._coasting.after(speed, self._interval_s))
        return math.inf

    def _for_signal(
        self,
        leg: Leg,
        line: StopLine,
        now_s: float,
        state: VehicleState,
        place_m: float,
        tail_m: float,
        ahead: SensedVehicle | None,
    ) -> float:
        """The speed that reaches the next stop line at green."""
        speed = state.speed_mps
        limit = leg.limits_mps[state.number]
        ahead_m = line.at_m - place_m
        greens = self._timings.upcoming(line.intersection, _group(line, state), now_s)
        earliest_s = now_s + free_drive_s(ahead_m, speed, limit, _ACCELERATION_MPS2)
        tail_s = tail_m / line.passing_mps
        arrive_s = choose_arrival_s(greens, now_s, earliest_s, tail_s, queue_length(ahead, ahead_m))
        if arrive_s is None or arrive_s <= earliest_s:
            return math.inf
        interval_s = self._interval_s
        wanted = arrival_speed_mps(
            self._coasting,
            ahead_m - speed * interval_s,
            arrive_s - now_s - interval_s,
        )
        if wanted is None:
            return max(MIN_MPS, self._coasting.after(speed, interval_s))
        return max(wanted, speed - _SLOWING_MPS2 * interval_s)


def _group(line: StopLine, state: VehicleState) -> int:
    """The signal group that a vehicle will meet: its lane's, where it is on the line's segment."""
    return line.group(state.lane if state.number == line.number else None)

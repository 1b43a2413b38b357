"""One interval's input: the vehicle on its leg, and the vehicle directly ahead of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from slipstream.energy.drafting import DragLaw
from slipstream.energy.traction import VehicleParameters
from slipstream.messages import PlannedSegment, PlatoonControl, SensedVehicle, VehicleSensing
from slipstream.spacing import ADVISED_GAP_M, MAX_BRAKING_MPS2, RESPONSE_S
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning.gap_control import COMFORTABLE_MPS2, Own
from vehicle_agent.platooning.interface import Gates
from vehicle_agent.platooning.neighbours import MAX_AHEAD_NS, SILENT_NS, Neighbours
from vehicle_agent.platooning.safe_gap import AheadMotion

MAX_SPEED_MPS: Final = 100.0
"""Values beyond these are taken as these: no vehicle of a road has them."""

_MAX_FRONT_M: Final = 1e5
_MAX_GAP_M: Final = 1e4
_MAX_ADVISED_GAP_M: Final = 50.0
_MAX_ACCELERATION_MPS2: Final = 3.0
_MIN_DESIRED_MPS: Final = 0.1

MAX_SENSING_AGE_NS: Final = 300_000_000
"""With older sensing of its own a vehicle leaves its platoon: two samples in a row were lost."""


@dataclass(frozen=True, slots=True)
class Situation:
    """Input of one interval's decisions.

    Attributes:
        place_m: of its front along the leg.
        limit_mps: speed limit here.
        lowest_mps: at the end of the interval, by the strongest braking.
        planned: the segment that it is on.
        motion: of the vehicle ahead; None: none is sensed.
        margin_m: added to the wanted gap: its way within the age of its own sensing.
        partner: what the vehicle ahead told; None: it is not of the fleet, or silent.
        sensing_in_time: whether the own sensing is neither late nor of the future.
    """

    now_ns: int
    leg: Leg
    state: VehicleState
    place_m: float
    limit_mps: float
    lowest_mps: float
    own: Own
    planned: PlannedSegment
    ahead: SensedVehicle | None
    motion: AheadMotion | None
    behind: SensedVehicle | None
    margin_m: float
    partner: PlatoonControl | None
    partner_age_s: float
    sensing_in_time: bool
    gates: Gates

    @property
    def gap_m(self) -> float:
        """To the vehicle directly ahead; infinite without one."""
        return math.inf if self.motion is None else self.motion.gap_m

    @property
    def max_speedup(self) -> float:
        """Share of its desired speed that the limit leaves it above."""
        return self.limit_mps / self.own.desired_mps - 1


def look(
    now_ns: int,
    leg: Leg,
    state: VehicleState,
    sensing: VehicleSensing,
    gates: Gates,
    neighbours: Neighbours,
    vehicle: VehicleParameters,
    pace: float,
    interval_s: float,
    drafting: DragLaw,
    commanded_mps: float | None,
) -> Situation:
    """The situation of a vehicle now; see `Platooning`. Sensing that is late is taken on to now:
    the vehicle has come to the speed that it was last commanded as far as it can have, and the one
    ahead has gone on as it moved and told.
    """
    late_ns = now_ns - sensing.time_ns
    late_s = _within(late_ns, 0, SILENT_NS) / 1e9
    sensed_mps = _within(state.speed_mps, 0.0, MAX_SPEED_MPS)
    speed_mps = sensed_mps
    if commanded_mps is not None:
        least_mps = max(0.0, sensed_mps - MAX_BRAKING_MPS2 * late_s)
        speed_mps = _within(commanded_mps, least_mps, sensed_mps + _MAX_ACCELERATION_MPS2 * late_s)
    moved_m = (sensed_mps + speed_mps) / 2 * late_s
    state = VehicleState(
        state.segment,
        state.number,
        state.crossing,
        state.lane,
        min(state.front_m, _MAX_FRONT_M),
        speed_mps,
        _within(state.acceleration_mps2, -MAX_BRAKING_MPS2, _MAX_ACCELERATION_MPS2),
    )
    planned, place_m = leg.planned[state.number], leg.place_m(state) + moved_m
    limit_mps = min(leg.limits_mps[state.number], MAX_SPEED_MPS)
    told = None if sensing.ahead is None else neighbours.fresh(sensing.ahead.vehicle, now_ns)
    partner, age_s = (None, 0.0) if told is None else told
    motion = None
    if sensing.ahead is not None:
        motion = ahead_motion(sensing.ahead, late_s, moved_m, partner, age_s, interval_s)
    return Situation(
        now_ns=now_ns,
        leg=leg,
        state=state,
        place_m=place_m,
        limit_mps=limit_mps,
        lowest_mps=max(0.0, min(sensed_mps, speed_mps) - MAX_BRAKING_MPS2 * interval_s),
        own=Own(
            speed_mps=state.speed_mps,
            max_mps=limit_mps,
            desired_mps=max(pace * limit_mps, _MIN_DESIRED_MPS),
            advised_gap_m=min(planned.gap_m or ADVISED_GAP_M, _MAX_ADVISED_GAP_M),
            interval_s=interval_s,
            vehicle=vehicle,
            drafting=drafting,
        ),
        planned=planned,
        ahead=sensing.ahead,
        motion=motion,
        behind=sensing.behind,
        margin_m=sensed_mps * late_s,
        partner=partner,
        partner_age_s=age_s,
        sensing_in_time=-MAX_AHEAD_NS <= late_ns <= MAX_SENSING_AGE_NS,
        gates=gates,
    )


def ahead_motion(
    sensed: SensedVehicle,
    late_s: float,
    moved_m: float,
    told: PlatoonControl | None,
    age_s: float,
    interval_s: float,
) -> AheadMotion:
    """Motion of the vehicle ahead by the own sensors, `late_s` ago, the own way within which was
    `moved_m`, and, while it is fresh, by what it told `age_s` ago, once an interval.
    """
    slowing = 0.0
    if told is not None:
        slowing = max(-told.acceleration_mps2, (told.speed_mps - told.announced_mps) / interval_s)
        slowing = _within(slowing, 0.0, MAX_BRAKING_MPS2)
    sensed_mps = _within(sensed.speed_mps, 0.0, MAX_SPEED_MPS)
    speed = max(0.0, sensed_mps - slowing * late_s)
    gap_m = _within(sensed.gap_m, -_MAX_GAP_M, _MAX_GAP_M)
    gap_m += (sensed_mps + speed) / 2 * late_s - moved_m
    coming_in_s = interval_s - age_s
    if told is None or coming_in_s <= 0:
        return AheadMotion(gap_m, speed, speed, slowing_mps2=slowing)
    announced = _within(
        told.announced_mps,
        max(0.0, speed - MAX_BRAKING_MPS2 * interval_s),
        speed + _MAX_ACCELERATION_MPS2 * interval_s,
    )
    trusted_s = max(0.0, interval_s - max(age_s, RESPONSE_S))
    return AheadMotion(gap_m, speed, announced, trusted_s, coming_in_s, slowing)


def allowed_mps(situation: Situation) -> float:
    """Highest speed at the end of the interval with which all limits ahead are kept comfortably.

    c²/2b + c Δt ≤ d + v²/2b for each place that is d ahead and may be passed with v.
    """
    allowed, state = situation.limit_mps, situation.state
    crossing = situation.planned.crossing
    if state.crossing and crossing is not None:
        allowed = min(allowed, crossing.speed_mps)
    b, slack = COMFORTABLE_MPS2, COMFORTABLE_MPS2 * situation.own.interval_s
    reach_m = allowed * allowed / (2 * b) + allowed * situation.own.interval_s
    for slow in situation.leg.slow_ahead(situation.place_m):
        away_m = slow.at_m - situation.place_m
        if away_m > reach_m:
            break
        root = math.sqrt(slack * slack + slow.speed_mps * slow.speed_mps + 2 * b * away_m)
        allowed = min(allowed, root - slack)
    return max(0.0, allowed)


def _within(value: float, low: float, high: float) -> float:
    return low if value < low else min(value, high)

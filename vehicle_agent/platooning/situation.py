"""One interval's input: the vehicle on its leg, and the vehicle directly ahead of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from slipstream.braking import GREATEST_MPS2, Braking
from slipstream.energy.drafting import DragLaw
from slipstream.energy.traction import VehicleParameters
from slipstream.messages import PlannedSegment, PlatoonControl, SensedVehicle, VehicleSensing
from slipstream.spacing import ADVISED_GAP_M, LIMIT_RATIO, RESPONSE_S, wanted_gap_m
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning.gap_control import COMFORTABLE_MPS2, Own
from vehicle_agent.platooning.interface import Gates
from vehicle_agent.platooning.needed_braking import AheadMotion, Evidence
from vehicle_agent.platooning.neighbours import MAX_AHEAD_NS, SILENT_NS, Neighbours

MAX_SPEED_MPS: Final = 100.0
"""Values beyond these are taken as these: no vehicle of a road has them."""

_MAX_FRONT_M: Final = 1e5
_MAX_GAP_M: Final = 1e4
_MAX_ADVISED_GAP_M: Final = 50.0
_MAX_ACCELERATION_MPS2: Final = 3.0
_MIN_DESIRED_MPS: Final = 0.1
_PARTING_MPS: Final = 0.5

MAX_SENSING_AGE_NS: Final = 300_000_000
"""With older sensing of its own a vehicle leaves its platoon: two samples in a row were lost."""


@dataclass(frozen=True, slots=True)
class OwnVehicle:
    """What a vehicle's platooning knows of it.

    Attributes:
        physics: for energies.
        braking: on the road as it is.
        others_mps2: the most that any vehicle brakes with on that road.
        interval_s: between two steps, and between two messages of every vehicle.
        pace: share of the limit that it drives at alone, in (0, 1].
        drafting: law of its drag reduction.
    """

    physics: VehicleParameters
    braking: Braking
    others_mps2: float
    interval_s: float
    pace: float
    drafting: DragLaw


@dataclass(frozen=True, slots=True)
class Commanded:
    """What was commanded last.

    Attributes:
        speed_mps: for the end of the last interval; None: nothing.
        recent_mps2: accelerations of the last intervals, the newest last.
        interval_s: of each.
    """

    speed_mps: float | None
    recent_mps2: tuple[float, ...]
    interval_s: float

    def pending_mps(self, acceleration_mps2: float, braking: Braking) -> float:
        """Change of speed by commands that have not taken effect yet, m/s."""
        if braking.nominal_s <= 0:
            return 0.0
        waiting = round(braking.dead_s / self.interval_s)
        sent = self.recent_mps2[-waiting:] if waiting else ()
        return acceleration_mps2 * braking.lag_s + sum(sent) * self.interval_s


@dataclass(frozen=True, slots=True)
class Situation:
    """Input of one interval's decisions.

    Attributes:
        place_m: of its front along the leg.
        limit_mps: speed limit here.
        lowest_mps: at the end of the interval, by full braking.
        planned: the segment that it is on.
        motion: of the vehicle ahead; None: none is sensed.
        wanted_m: g*, to the vehicle ahead; it grows with the age of the own sensing.
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
    wanted_m: float
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
    evidence: Evidence,
    own: OwnVehicle,
    commanded: Commanded,
) -> Situation:
    """The situation of a vehicle now; see `Platooning`. Sensing that is late is taken on to now:
    the vehicle has come to the speed that it was last commanded as far as it can have, and the one
    ahead has gone on as it moved and told.
    """
    interval_s, braking = own.interval_s, own.braking
    late_ns = now_ns - sensing.time_ns
    late_s = _within(late_ns, 0, SILENT_NS) / 1e9
    sensed_mps = _within(state.speed_mps, 0.0, MAX_SPEED_MPS)
    speed_mps = sensed_mps
    if commanded.speed_mps is not None:
        least_mps = max(0.0, sensed_mps - braking.greatest_mps2 * late_s)
        speed_mps = _within(
            commanded.speed_mps, least_mps, sensed_mps + _MAX_ACCELERATION_MPS2 * late_s
        )
    moved_m = (sensed_mps + speed_mps) / 2 * late_s
    acceleration = _within(state.acceleration_mps2, -GREATEST_MPS2, _MAX_ACCELERATION_MPS2)
    state = VehicleState(
        state.segment,
        state.number,
        state.crossing,
        state.lane,
        min(state.front_m, _MAX_FRONT_M),
        speed_mps,
        acceleration,
    )
    planned, place_m = leg.planned[state.number], leg.place_m(state) + moved_m
    limit_mps = min(leg.limits_mps[state.number], MAX_SPEED_MPS)
    ahead = sensing.ahead
    told = None if ahead is None else neighbours.fresh(ahead.vehicle, now_ns)
    partner, age_s = (None, 0.0) if told is None else told
    follower = Own(
        speed_mps=state.speed_mps,
        max_mps=limit_mps,
        desired_mps=max(own.pace * limit_mps, _MIN_DESIRED_MPS),
        advised_gap_m=min(planned.gap_m or ADVISED_GAP_M, _MAX_ADVISED_GAP_M),
        interval_s=interval_s,
        vehicle=own.physics,
        braking=braking,
        drafting=own.drafting,
        effective_mps=max(0.0, speed_mps + commanded.pending_mps(acceleration, braking)),
    )
    motion, wanted_m = None, follower.close_gap_m(follower.speed_mps)
    if ahead is not None:
        motion = ahead_motion(ahead, late_s, moved_m, partner, age_s, own)
        if partner is not None and partner.mode == "following":
            leader = neighbours.fresh(partner.leader, now_ns)
            if leader is not None and partner.leader != partner.vehicle:
                motion = _led(motion, *leader, interval_s)
        tells = max(motion.slowing_mps2, -(motion.trend_mps2 or 0.0))
        if evidence.update(sensing.time_ns, ahead.track, ahead.speed_mps, tells):
            slowing = _within(-evidence.span_mps2[0], motion.slowing_mps2, own.others_mps2)
            motion = replace(motion, slowing_mps2=slowing, trend_mps2=None)
        elif motion.trend_mps2 is not None:
            motion = replace(motion, trend_mps2=min(motion.trend_mps2, evidence.span_mps2[1]))
        aged = replace(braking, sensing_s=max(braking.sensing_s, late_s))
        wanted_m = wanted_gap_m(
            follower.speed_mps, follower.advised_gap_m, motion.bound_mps2, aged, interval_s
        )
    else:
        evidence.update(sensing.time_ns, None, 0.0, 0.0)
    return Situation(
        now_ns=now_ns,
        leg=leg,
        state=state,
        place_m=place_m,
        limit_mps=limit_mps,
        lowest_mps=max(0.0, min(sensed_mps, speed_mps) - braking.guaranteed_mps2 * interval_s),
        own=follower,
        planned=planned,
        ahead=ahead,
        motion=motion,
        behind=sensing.behind,
        wanted_m=wanted_m,
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
    own: OwnVehicle,
) -> AheadMotion:
    """Motion of the vehicle ahead by the own sensors, `late_s` ago, the own way within which was
    `moved_m`, and by what it told `age_s` ago, while it is fresh.

    What it may brake with is what it has promised, where the own brakes allow for a close gap, and
    else what it tells that it can; of who is silent what the hardest braking vehicle can.
    """
    slowing, bound, feed = 0.0, own.others_mps2, 0.0
    trend = None
    if told is not None:
        bound = min(bound, told.greatest_mps2)
        hardest = own.others_mps2
        if told.limit_mps2 is not None and own.braking.emergency_brake:
            bound = min(bound, told.limit_mps2)
            if own.interval_s <= RESPONSE_S:
                # What it can answer without breaking its own promise; more counts once sensed.
                hardest = min(hardest, LIMIT_RATIO * told.limit_mps2)
        trend = _within(told.acceleration_mps2, -hardest, 0.0)
        planned = planned_mps2(told, age_s, own.interval_s)
        if planned is not None:
            feed = _within(planned, -hardest, _MAX_ACCELERATION_MPS2)
        slowing = max(0.0, -trend if planned is None else -feed)
    sensed_mps = _within(sensed.speed_mps, 0.0, MAX_SPEED_MPS)
    speed = max(0.0, sensed_mps - slowing * late_s)
    if told is not None and trend is not None and late_s > age_s:
        # What it told is newer than what was sensed; it is believed where it is slower.
        speed = min(speed, max(0.0, told.speed_mps + trend * age_s))
    gap_m = _within(sensed.gap_m, -_MAX_GAP_M, _MAX_GAP_M)
    gap_m += (sensed_mps + speed) / 2 * late_s - moved_m
    return AheadMotion(gap_m, speed, slowing, feed, bound, trend_mps2=trend)


def planned_mps2(told: PlatoonControl, age_s: float, interval_s: float) -> float | None:
    """Acceleration that a vehicle told for now, age_s ago, the last one for one interval more, and
    braking for as long as it counts as heard; None: it told none that far ahead.
    """
    number, planned = int(age_s / interval_s + 1e-3), told.planned_mps2
    if not planned or (number > len(planned) and planned[-1] >= 0):
        return None
    return planned[min(number, len(planned) - 1)]


def _led(
    motion: AheadMotion, leader: PlatoonControl, age_s: float, interval_s: float
) -> AheadMotion:
    """The same with what the leader of the platoon drives, where it told so far ahead and the
    vehicle directly ahead is not about to part from it.
    """
    planned = planned_mps2(leader, age_s, interval_s)
    if planned is None:
        return motion
    driven = leader.planned_mps2[: round(age_s / interval_s)]
    then_mps = leader.speed_mps + sum(driven) * interval_s
    if motion.speed_mps < then_mps - _PARTING_MPS:
        return motion
    feed = _within(planned, -motion.bound_mps2, _MAX_ACCELERATION_MPS2)
    return replace(
        motion,
        feed_mps2=feed,
        slowing_mps2=max(0.0, -feed),
        leader_mps=_within(then_mps, 0.0, MAX_SPEED_MPS),
    )


def allowed_mps(
    situation: Situation, within_s: float, braking_mps2: float = COMFORTABLE_MPS2
) -> float:
    """Highest speed after a time with which all limits ahead are kept by a deceleration b.

    c²/2b + c t ≤ d + v²/2b for each place that is d ahead and may be passed with v.
    """
    allowed, state = situation.limit_mps, situation.state
    crossing = situation.planned.crossing
    if state.crossing and crossing is not None:
        allowed = min(allowed, crossing.speed_mps)
    b, slack = braking_mps2, braking_mps2 * within_s
    reach_m = allowed * allowed / (2 * b) + allowed * within_s
    for slow in situation.leg.slow_ahead(situation.place_m):
        away_m = slow.at_m - situation.place_m
        if away_m > reach_m:
            break
        root = math.sqrt(slack * slack + slow.speed_mps * slow.speed_mps + 2 * b * away_m)
        allowed = min(allowed, root - slack)
    return max(0.0, allowed)


def _within(value: float, low: float, high: float) -> float:
    return low if value < low else min(value, high)

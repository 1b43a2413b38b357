"""Whether a vehicle may follow the one directly ahead: gates, the shared path, what it saves."""

from __future__ import annotations

from typing import Final

from slipstream.messages import PlatoonControl
from slipstream.spacing import wanted_gap_m
from vehicle_agent.platooning.gap_control import (
    CLOSE_GAP_M,
    IDM,
    MIN_SPEED_MPS,
    leaving_distance_m,
)
from vehicle_agent.platooning.rendezvous import MARGIN_KWH, best_rendezvous
from vehicle_agent.platooning.shared_path import SharedPath, find_shared_path
from vehicle_agent.platooning.situation import Situation

_START_M: Final = 10.0
_JOIN_SPACINGS: Final = 2.0
_KEEP_SPACINGS: Final = 3.0

NONE_AHEAD: Final = "no vehicle is sensed ahead"
"""The one obstacle that may be the sensor's, for a moment."""


def obstacle(situation: Situation, *, keeps: bool) -> str | None:
    """Why a vehicle may not follow the one directly ahead, in words for people; None: it may.

    Args:
        keeps: whether it follows that one already.
    """
    s = situation
    if not s.sensing_in_time:
        return "the own sensing is late"
    if s.ahead is None:
        return NONE_AHEAD
    if s.ahead.vehicle is None:
        return "the vehicle ahead is not of the fleet"
    if s.partner is None:
        return f"{s.ahead.vehicle} is silent"
    shared = find_shared_path(s.leg, s.state.number, s.place_m, s.partner, s.partner_age_s)
    if shared is None:
        return f"{s.partner.vehicle} drives another way"
    return _worth(s, shared, s.partner, keeps=keeps)


def turbulent_segment(situation: Situation) -> str | None:
    """Segment of the vehicle or of the one directly ahead that has turbulent traffic."""
    here = situation.state.segment
    if situation.gates.is_turbulent(here):
        return here
    there = here if situation.partner is None else situation.partner.path[0]
    return there if there != here and situation.gates.is_turbulent(there) else None


def is_planned_behind(situation: Situation, front: PlatoonControl) -> bool:
    """Whether the plan has the vehicle behind another one in the same platoon here."""
    planned = situation.planned
    return (
        planned.platoon is not None
        and planned.platoon == front.platoon
        and planned.place is not None
        and front.place is not None
        and front.place < planned.place
    )


def _worth(s: Situation, shared: SharedPath, front: PlatoonControl, *, keeps: bool) -> str | None:
    """Why joining, or staying, does not pay on the open road ahead; None: it does."""
    run_m = shared.open_distance_m(s.gates.is_open)
    if not s.gates.is_open(s.state.segment):
        return f"the gate of {s.state.segment} is not open"
    speed_mps, gap_m, own = s.state.speed_mps, s.gap_m, s.own
    # From farther away the car-following model does better, with signals and others in between.
    spacing_m = _START_M + IDM.desired_gap_m(speed_mps)
    if gap_m > (_KEEP_SPACINGS if keeps else _JOIN_SPACINGS) * spacing_m:
        return f"{front.vehicle} is too far ahead"
    short = "the shared road with open gates is too short"
    if keeps:
        return None if run_m > leaving_distance_m(speed_mps, gap_m, own.vehicle) else short
    cruise_mps = max(MIN_SPEED_MPS, own.desired_mps)
    followed_m = wanted_gap_m(cruise_mps, own.advised_gap_m, own.interval_s)
    drafted_m = run_m - leaving_distance_m(cruise_mps, followed_m, own.vehicle)
    if gap_m <= max(CLOSE_GAP_M, followed_m):
        return None if drafted_m > 0 else short
    rendezvous = best_rendezvous(
        gap_m - followed_m,
        cruise_mps,
        lambda way_m: max(0.0, drafted_m - way_m),
        own.reductions(cruise_mps).follower,
        max_speedup=s.max_speedup,
        vehicle=own.vehicle,
        margin_kwh=0.0 if is_planned_behind(s, front) else MARGIN_KWH,
    )
    return short if rendezvous is None else None

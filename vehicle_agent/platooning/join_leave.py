"""Whether a vehicle may follow the one directly ahead: gates, the shared path, what it saves; and
which of those behind it it believes that they follow it or come.
"""

from __future__ import annotations

from typing import Final

from slipstream.messages import PlatoonControl
from slipstream.spacing import CLOSE_GAP_M
from vehicle_agent.platooning.gap_control import (
    IDM,
    MIN_SPEED_MPS,
    leaving_distance_m,
)
from vehicle_agent.platooning.neighbours import Neighbours
from vehicle_agent.platooning.rendezvous import MARGIN_KWH, best_rendezvous
from vehicle_agent.platooning.shared_path import (
    PLACE_TOLERANCE_M,
    SharedPath,
    comes_behind,
    find_shared_path,
)
from vehicle_agent.platooning.situation import Situation

_START_M: Final = 10.0
_JOIN_SPACINGS: Final = 2.0
_KEEP_SPACINGS: Final = 3.0

NONE_AHEAD: Final = "no vehicle is sensed ahead"
"""The one obstacle that may be the sensor's, for a moment."""


def obstacle(situation: Situation, *, keeps: bool) -> str | None:
    """Why a vehicle may not follow, or go on following (`keeps`), the one directly ahead, in words
    for people; None: it may.
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
    if abs(shared.spacing_m - s.partner.length_m - s.gap_m) > PLACE_TOLERANCE_M:
        return f"{s.partner.vehicle} tells another place than it is sensed at"
    return _worth(s, shared, s.partner, keeps=keeps)


def no_waiting_for(situation: Situation, neighbours: Neighbours, vehicle: str) -> str | None:
    """Why a vehicle that asks is not waited for, in words for people; None: it may come."""
    heard = neighbours.fresh(vehicle, situation.now_ns)
    if heard is None:
        return f"{vehicle} was not heard"
    if not comes_behind(situation.leg, situation.state, heard[0]):
        return f"{vehicle} is not behind on the same road"
    return None


def vehicles_up_to(front: PlatoonControl, neighbours: Neighbours) -> int:
    """Number of vehicles of a platoon from its leader to one of them, as far as they are heard."""
    names = [front.vehicle]
    while front.mode == "following" and front.ahead is not None and front.ahead not in names:
        names.append(front.ahead)
        front = neighbours.get(front.ahead) or front
    return len(names)


def too_long(
    s: Situation, front: PlatoonControl, neighbours: Neighbours, behind: int
) -> str | None:
    """Why a platoon is too long with this vehicle behind one of its vehicles; None: it is not.

    Args:
        behind: number of vehicles that come with it.
    """
    longest = s.own.longest_string
    if vehicles_up_to(front, neighbours) + 1 + behind <= longest:
        return None
    return f"with its brakes a platoon has {longest} vehicles at most"


def followers(
    situation: Situation, neighbours: Neighbours, vehicle: str
) -> tuple[PlatoonControl, ...]:
    """Last messages of all who follow a vehicle, or others that do, front to back.

    Believed is who comes from behind, is not so far from the one ahead of it that it would leave
    it, and, directly behind, is where the own sensing has it.
    """
    s, found, chain = situation, [], [vehicle]
    told = [heard.message for heard in neighbours if heard.message.mode == "following"]
    for ahead in chain:
        direct = [one for one in told if one.ahead == ahead and _is_where_it_tells(s, one, vehicle)]
        found += direct
        chain += [one.vehicle for one in direct if one.vehicle not in chain]
    return tuple(found)


def _is_where_it_tells(s: Situation, follower: PlatoonControl, vehicle: str) -> bool:
    gap_m, sensed = follower.gap_m, s.behind
    if not comes_behind(s.leg, s.state, follower):
        return False
    if gap_m is None:
        return True
    if gap_m > _KEEP_SPACINGS * _spacing_m(follower.speed_mps):
        return False
    if sensed is None or follower.ahead != vehicle:
        return True
    recognised = sensed.vehicle in (None, follower.vehicle)
    return recognised and abs(sensed.gap_m - gap_m) <= PLACE_TOLERANCE_M


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
    if gap_m > (_KEEP_SPACINGS if keeps else _JOIN_SPACINGS) * _spacing_m(speed_mps):
        return f"{front.vehicle} is too far ahead"
    short = "the shared road with open gates is too short"
    if keeps:
        return None if run_m > leaving_distance_m(speed_mps, gap_m, own.vehicle) else short
    cruise_mps = max(MIN_SPEED_MPS, own.desired_mps)
    followed_m = own.close_gap_m(cruise_mps)
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


def _spacing_m(speed_mps: float) -> float:
    """Unit of the gaps up to which vehicles join and stay. From farther away the car-following
    model does better, with signals and others in between.
    """
    return _START_M + IDM.desired_gap_m(speed_mps)

"""Drag reductions by the gaps that vehicles of the fleet have in the running simulation.

They are measured, not told by agents, and credited for gaps of at most 7.5 m, at 5 m/s and more,
behind an open gate. By a measured law the reduction is that of the gap in the simulation and of the
place in the row of vehicles that close up. The paper's is that of the advised gap of 1.5 m: in
steps of 0.5 s followers keep 2.4 m and more, and the advised gap is given in the evaluation, not
in the motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol, get_args

from slipstream.energy.drafting import DragLaw, reductions_at
from slipstream.messages import PlannedSegment, VehicleAdvice, VehicleSensing
from slipstream.spacing import CLOSE_GAP_M
from vehicle_agent.platooning import MIN_SPEED_MPS

Cause = Literal["gates", "queues", "others between", "closing up", "apart"]
CAUSES: Final[tuple[Cause, ...]] = get_args(Cause)
"""Why a planned platoon is not driven: a gate that is not open, or parting before one; slow
traffic; other vehicles; a gap that is still too large, its own or that of those behind a leader;
partners that have not met, as one of them left late or drives late."""

_QUEUE_SHARE: Final = 0.7


class RoadsideGates(Protocol):
    """Gate and true traffic of a segment."""

    def is_open(self, segment: str) -> bool:
        """Whether close gaps are allowed on it."""
        ...

    def is_turbulent(self, segment: str) -> bool:
        """Whether its true traffic is turbulent."""
        ...


@dataclass(frozen=True)
class Drafting:
    """Platooning in one step.

    Attributes:
        eta: drag reduction by vehicle of a platoon; others are left out.
        turbulent: vehicles in a close gap, leaving ones included, on segments whose true traffic is
            turbulent.
    """

    eta: Mapping[str, float] = field(default_factory=dict)
    places: Mapping[str, int] = field(default_factory=dict)
    turbulent: frozenset[str] = frozenset()


def drafting(
    sensed: Mapping[str, VehicleSensing],
    following: Mapping[str, bool],
    gates: RoadsideGates,
    laws: Mapping[str, DragLaw] | None = None,
) -> Drafting:
    """The drag reductions of a step. `laws`: by vehicle; of others the paper's."""
    front_of: dict[str, str] = {}
    ahead_m: dict[str, float] = {}
    behind_m: dict[str, float] = {}
    exposed: set[str] = set()
    for name, follows in following.items():
        own = sensed[name]
        ahead = own.ahead
        if ahead is None or ahead.vehicle is None or ahead.gap_m > CLOSE_GAP_M:
            continue
        front = sensed.get(ahead.vehicle)
        if front is None:
            continue
        exposed.update(v.vehicle for v in (own, front) if gates.is_turbulent(v.segment))
        fast = min(own.speed_mps, front.speed_mps) >= MIN_SPEED_MPS
        if follows and fast and gates.is_open(own.segment):
            front_of[name], ahead_m[name] = front.vehicle, ahead.gap_m
            behind_m[front.vehicle] = min(ahead.gap_m, behind_m.get(front.vehicle, ahead.gap_m))
    places = {name: _place(name, front_of) for name in front_of}
    leaders = [name for name in behind_m if name not in front_of]
    places |= dict.fromkeys((n for n in leaders if gates.is_open(sensed[n].segment)), 0)
    eta, law_of = {}, laws or {}
    for name, place in places.items():
        gap_m = ahead_m[name] if place > 0 else behind_m[name]
        reductions = reductions_at(law_of.get(name, "paper"), gap_m)
        eta[name] = reductions.at(place, place + 1 + (name in behind_m))
    return Drafting(eta, places, frozenset(exposed))


def _place(name: str, front_of: Mapping[str, str]) -> int:
    """Vehicles in front of one in its row; where a row closes to a ring, all others."""
    place = 0
    while name in front_of and place < len(front_of):
        place, name = place + 1, front_of[name]
    return place


def why_missed(
    planned: PlannedSegment,
    sensed: VehicleSensing,
    advice: VehicleAdvice | None,
    top_mps: float,
    *,
    is_open: bool,
) -> Cause | None:
    """Why a vehicle that drives no faster than `top_mps` and is in no platoon now is in none; None:
    its plan has none there either.
    """
    if planned.platoon is None:
        return None
    if not is_open:
        return "gates"
    limit_mps = min(planned.speed_limit_mps or planned.speed_mps, top_mps)
    if sensed.speed_mps < _QUEUE_SHARE * limit_mps:
        return "queues"
    mode = "none" if advice is None else advice.mode
    if sensed.ahead is not None and sensed.ahead.vehicle is None and mode == "open_gap":
        return "others between"
    if mode == "open_gap":
        return "gates"
    if mode == "follow" or (advice is not None and advice.partner is not None):
        return "closing up"
    return "apart"

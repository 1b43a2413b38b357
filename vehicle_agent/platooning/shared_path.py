"""The path that a vehicle shares with one ahead of it, and where on it the gates are open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from slipstream.messages import PlatoonControl
from vehicle_agent.leg import Leg, VehicleState

MAX_DISTANCE_M: Final = 2000.0
"""Largest distance of a rendezvous."""

PLACE_TOLERANCE_M: Final = 10.0
"""Between what two vehicles say of a place: each knows its own to some metres."""


@dataclass(frozen=True, slots=True)
class SharedPath:
    """Segments that the rear vehicle will drive behind the front one.

    Attributes:
        spacing_m: between both fronts along the path.
        parts: segments from the rear one's on to the last common one, each with the distance from
            the rear one's front to its end, m.
        meets: number of the front one's segment in the parts.
    """

    spacing_m: float
    parts: tuple[tuple[str, float], ...]
    meets: int

    def open_distance_m(self, is_open: Callable[[str], bool]) -> float:
        """From the rear one's front to where the gates stop being open, m; 0 where they are not."""
        run = 0.0
        for segment, end_m in self.parts:
            if not is_open(segment):
                break
            run = end_m
        return run

    def open_beyond_m(self, begin_m: float, is_open: Callable[[str], bool]) -> float:
        """Metres with open gates from a distance ahead of the rear one on."""
        total, last = 0.0, 0.0
        for segment, end_m in self.parts:
            if end_m > begin_m and is_open(segment):
                total += end_m - max(begin_m, last)
            last = end_m
        return total


def spacing_m(leg: Leg, number: int, place_m: float, front: PlatoonControl, age_s: float) -> float:
    """Distance to the front of a vehicle ahead on the leg; infinite where it is not, or too far.

    Args:
        number: of the rear vehicle's segment on its leg.
        place_m: of its front along its leg.
        front: what the other vehicle told.
        age_s: of that; it has driven on since.
    """
    meets = _meets(leg, number, place_m, front.path[0])
    if meets < 0:
        return float("inf")
    begins_m = leg.ends_m[meets] if front.crossing else leg.begins_m[meets]
    spacing = begins_m + front.front_m + front.speed_mps * age_s - place_m
    if meets == number and spacing <= 0:
        return float("inf")
    # The rear one may have come farther through the junction between than the front one beyond it.
    return max(spacing, 0.0) if spacing <= MAX_DISTANCE_M else float("inf")


def comes_behind(leg: Leg, state: VehicleState, rear: PlatoonControl) -> bool:
    """Whether another vehicle's path leads to where this one is, from behind it."""
    here = leg.path[state.number]
    if rear.path[0] != here:
        return here in rear.path and rear.path[0] not in leg.path[state.number :]
    if rear.crossing != state.crossing:
        return state.crossing
    return rear.front_m < state.front_m + PLACE_TOLERANCE_M


def find_shared_path(
    leg: Leg, number: int, place_m: float, front: PlatoonControl, age_s: float
) -> SharedPath | None:
    """What a vehicle has in common with one ahead of it, as of `spacing_m`; None if it is not ahead
    or too far.
    """
    spacing = spacing_m(leg, number, place_m, front, age_s)
    if spacing > MAX_DISTANCE_M:
        return None
    meets = last = _meets(leg, number, place_m, front.path[0])
    for mine, other in zip(leg.path[meets:], front.path, strict=False):
        if mine != other:
            break
        last += 1
    ends_m = leg.ends_m
    parts = tuple((leg.path[i], ends_m[i] - place_m) for i in range(number, last))
    return SharedPath(spacing, parts, meets - number)


def _meets(leg: Leg, number: int, place_m: float, segment: str) -> int:
    """Number of a segment on the leg, from one on, within the largest distance; -1: none."""
    begins_m, path = leg.begins_m, leg.path
    for i in range(number, len(path)):
        if path[i] == segment:
            return i
        if begins_m[i] > place_m + MAX_DISTANCE_M:
            break
    return -1

"""A vehicle of the fleet on one leg: its order, and its state in the running simulation.

Each leg is a separate SUMO vehicle, from rest at one place to rest at the next, as the dispatcher
plans it. Customers are beside the road, so service blocks no lane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from slipstream.messages import DrivingAdvice, PlannedSegment

SPEED_CHECKS: Final = 0b11011
"""SUMO's speed mode: all checks except the limit on deceleration. With that limit, a vehicle whose
speed is set would brake no harder than comfortable, even for a red light or a cut-in."""

PREFIX: Final = "cav/"
"""SUMO ids of the fleet's vehicles begin with it; no id of the background does."""


@dataclass(frozen=True)
class LegOrder:
    """One leg as its vehicle is to drive it.

    Attributes:
        vehicle: of the fleet.
        round: number of the tour in the vehicle's day, from 0.
        leg: number in the tour, from 0.
        path: segments, the first one left from its beginning, the last one driven to its end.
        ready_s: from when on it could have left, s since midnight; travel time counts from then.
        due_s: when to leave, later where the plan has it wait to meet others.
        free_s: what the leg takes at the limit on an empty road.
        planned: the plan's segments of this leg, in order, with platoons and entry times.
        advice: how to drive.
    """

    vehicle: str
    round: int
    leg: int
    path: tuple[str, ...]
    ready_s: float
    due_s: float
    free_s: float
    planned: tuple[PlannedSegment, ...]
    advice: DrivingAdvice

    @property
    def id(self) -> str:
        """Its id in SUMO."""
        return f"{PREFIX}{self.vehicle}/{self.round}/{self.leg}"


@dataclass(frozen=True)
class VehicleState:
    """Where a vehicle is after a step.

    Attributes:
        segment: of its path that it is on, or that it has just left while it crosses a junction.
        number: of that segment in the path.
        crossing: whether it is in a junction, between that segment and the next one.
        lane: index of its lane.
        front_m: of its front, along the segment, or along the lane through the junction.
        speed_mps: now.
        driven_m: since it came onto the road.
    """

    segment: str
    number: int
    crossing: bool
    lane: int
    front_m: float
    speed_mps: float
    driven_m: float


def read_state(name: str, order: LegOrder, behind: int = 0) -> VehicleState:
    """The state of a vehicle of the running simulation; it must be on the road.

    Args:
        behind: segments of the path that lay behind it when SUMO was given its present route.
    """
    import libsumo

    vehicle = libsumo.vehicle
    number = behind + max(0, vehicle.getRouteIndex(name))
    return VehicleState(
        order.path[number],
        number,
        vehicle.getRoadID(name).startswith(":"),
        vehicle.getLaneIndex(name),
        vehicle.getLanePosition(name),
        vehicle.getSpeed(name),
        vehicle.getDistance(name),
    )


def free_drive_s(
    distance_m: float, speed_mps: float, limit_mps: float, acceleration_mps2: float = 1.8
) -> float:
    """Time to drive a distance on a free road, s: acceleration to the limit, then the limit."""
    if speed_mps >= limit_mps:
        return distance_m / limit_mps
    gaining_m = (limit_mps**2 - speed_mps**2) / (2 * acceleration_mps2)
    if gaining_m >= distance_m:
        reached_mps = math.sqrt(speed_mps**2 + 2 * acceleration_mps2 * distance_m)
        return (reached_mps - speed_mps) / acceleration_mps2
    return (limit_mps - speed_mps) / acceleration_mps2 + (distance_m - gaining_m) / limit_mps

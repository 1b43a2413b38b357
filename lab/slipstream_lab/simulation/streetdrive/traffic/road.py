"""StreetDrive's straight two-way road, and the motion of a vehicle on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
LengthOf = Callable[[int], float]


@dataclass(frozen=True)
class Lane:
    """One lane: its centre line's y in metres and its direction of travel along x (+1 or -1)."""

    y_m: float
    direction: int


@dataclass(frozen=True)
class Road:
    """Cross-section of the road; right-hand traffic, so incoming lanes lie at y > 0."""

    incoming_lanes: int = 2
    outgoing_lanes: int = 2
    lane_width_m: float = 3.5
    median_m: float = 0.6
    shoulder_m: float = 0.5
    pavement_m: float = 2.5

    def __post_init__(self) -> None:
        if self.incoming_lanes < 1 or self.outgoing_lanes < 0:
            raise ValueError("a road has at least one incoming lane and no negative count of lanes")
        if min(self.lane_width_m, self.shoulder_m) <= 0 or min(self.median_m, self.pavement_m) < 0:
            raise ValueError("widths are positive (median and pavement may be 0)")

    @property
    def left_edge_m(self) -> float:
        """y of the carriageway's edge on the incoming side."""
        return self.median_m / 2 + self.incoming_lanes * self.lane_width_m + self.shoulder_m

    @property
    def right_edge_m(self) -> float:
        """y of the carriageway's edge on the outgoing side (negative)."""
        return -(self.median_m / 2 + self.outgoing_lanes * self.lane_width_m + self.shoulder_m)

    @property
    def lanes(self) -> tuple[Lane, ...]:
        """All lanes, incoming first, each side from the median outwards."""
        first = self.median_m / 2 + self.lane_width_m / 2
        incoming = (Lane(first + i * self.lane_width_m, -1) for i in range(self.incoming_lanes))
        outgoing = (Lane(-first - i * self.lane_width_m, 1) for i in range(self.outgoing_lanes))
        return (*incoming, *outgoing)

    def strip_m(self, direction: int) -> tuple[float, float]:
        """The lowest and highest y of the lanes in one direction (-1 incoming, +1 outgoing)."""
        count = self.incoming_lanes if direction < 0 else self.outgoing_lanes
        inner, outer = self.median_m / 2, self.median_m / 2 + count * self.lane_width_m
        return (inner, outer) if direction < 0 else (-outer, -inner)


@dataclass(frozen=True)
class VehicleTrack:
    """One vehicle's motion: frames first_frame, first_frame + 1, … at a constant frame rate.

    `x_m` is the ground centre; speed and acceleration are positive along the lane's direction.
    """

    vehicle_id: int
    lane: Lane
    first_frame: int
    x_m: Floats
    speed_mps: Floats
    acceleration_mps2: Floats

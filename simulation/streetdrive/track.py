"""The motion of one vehicle through a clip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulation.streetdrive.road import Lane

Floats = NDArray[np.float64]
LengthOf = Callable[[int], float]


@dataclass(frozen=True)
class Track:
    """One vehicle's motion: frames first_frame, first_frame + 1, … at a constant frame rate.

    `x_m` is the ground centre; speed and acceleration are positive along the lane's direction.
    """

    vehicle_id: int
    lane: Lane
    first_frame: int
    x_m: Floats
    speed_mps: Floats
    acceleration_mps2: Floats

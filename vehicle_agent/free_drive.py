"""How long a vehicle takes over a distance that nothing hinders it on."""

from __future__ import annotations

import math


def free_drive_s(
    distance_m: float, speed_mps: float, limit_mps: float, acceleration_mps2: float = 1.8
) -> float:
    """Time to drive a distance on a free road, s: acceleration to the limit, then the limit."""
    if speed_mps >= limit_mps:
        return distance_m / limit_mps
    gaining_m = (limit_mps * limit_mps - speed_mps * speed_mps) / (2 * acceleration_mps2)
    if gaining_m >= distance_m:
        reached_mps = math.sqrt(speed_mps * speed_mps + 2 * acceleration_mps2 * distance_m)
        return (reached_mps - speed_mps) / acceleration_mps2
    return (limit_mps - speed_mps) / acceleration_mps2 + (distance_m - gaining_m) / limit_mps

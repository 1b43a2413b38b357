"""Where the vehicles are at each frame: SUMO's steps, read between them by SUMO's own law."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from slipstream_lab.simulation.sumo_view.shapes import Kind

STEP_S: Final = 0.02
"""SUMO's step whatever the frame rate is, so that the traffic of a seed does not depend on it."""


@dataclass(frozen=True)
class State:
    """A vehicle at one step.

    Attributes:
        speed_mps: over ground: SUMO's speed along its lane times the lane's drawn length over its
            driven one, which is 1 on straight lanes and differs by percents in curves.
    """

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    acceleration_mps2: float


@dataclass(frozen=True)
class ViewedVehicle:
    """A vehicle at a frame: `x_m`, `y_m` is its ground centre in the net.

    `number` counts vehicles in the order in which they come into view.
    """

    number: int
    kind: Kind
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    acceleration_mps2: float


def between(before: State, after: State, elapsed_s: float) -> State:
    """The state some time after one step and before the next.

    In a step SUMO's ballistic law holds the acceleration, so speed is linear and distance
    quadratic in time; in 20 ms a way is straight.
    """
    gained = (after.speed_mps - before.speed_mps) / STEP_S
    way = (before.speed_mps + after.speed_mps) / 2 * STEP_S
    done = before.speed_mps * elapsed_s + gained * elapsed_s**2 / 2
    share = min(max(done / way, 0.0), 1.0) if way > 1e-6 else elapsed_s / STEP_S
    turn = math.remainder(after.heading_rad - before.heading_rad, 2 * math.pi)
    return State(
        before.x_m + (after.x_m - before.x_m) * share,
        before.y_m + (after.y_m - before.y_m) * share,
        before.heading_rad + turn * share,
        before.speed_mps + gained * elapsed_s,
        before.acceleration_mps2 if elapsed_s == 0.0 else after.acceleration_mps2,
    )

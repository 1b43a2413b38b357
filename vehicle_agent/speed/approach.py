"""Eco-approach: which green of a signal to reach, and the speed for it.

A red that cannot be passed costs its time anyway; the question is how to spend it. For a given
time and distance the energy is least if the vehicle brakes first and then rolls to the stop line:
what it keeps of its speed there it need not gain again, and rolling needs no traction. (By
Pontryagin with a price of time that is negative before the line, since being early is worth
nothing.) So the advice is the speed from which rolling reaches the line just then: faster vehicles
slow down to it, slower ones may still gain speed, and a vehicle at it coasts.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from vehicle_agent.signals import Green
from vehicle_agent.speed.coasting import CoastingModel

CERTAIN_S: Final = 1.5
"""From a fixed green's begin to the arrival, and from the platoon's last vehicle to its end."""
UNCERTAIN_S: Final = 3.0
"""The former for a green whose begin is the earliest one."""
MIN_MPS: Final = 5.0
"""No slower approach than this; who would have to be slower stops at the line."""
_QUEUED_S: Final = 2.0
"""What each vehicle that waits at the line needs to get away."""


def choose_arrival_s(
    greens: Iterable[Green],
    now_s: float,
    earliest_s: float,
    tail_s: float,
    queue: int,
) -> float | None:
    """The earliest time to reach a signal at: `earliest_s`, unhindered, if it can pass then; a
    later time in a green; None if nothing is known of the next green that it can take.

    `tail_s` is from its passing to that of the last vehicle behind it that goes with it, `queue`
    how many wait at the line.
    """
    for green in greens:
        running = green.begin_s <= now_s
        margin_s = CERTAIN_S if green.certain else UNCERTAIN_S
        opens_s = green.begin_s + margin_s + queue * _QUEUED_S
        arrive_s = earliest_s if running and not queue else max(earliest_s, opens_s)
        if not green.certain:
            # An actuated green is extended for vehicles that arrive after its earliest end.
            return arrive_s
        if arrive_s + tail_s <= green.end_s - CERTAIN_S:
            return arrive_s
    return None


def arrival_speed_mps(
    coasting: CoastingModel,
    distance_m: float,
    remaining_s: float,
) -> float | None:
    """The speed from which rolling reaches the line in time, or one speed all the way where rolling
    would end below the least; None: too slow, it will stop there.
    """
    if distance_m <= 0 or remaining_s <= 0:
        return None
    if distance_m / remaining_s < MIN_MPS:
        return None
    speed = coasting.speed_for(distance_m, remaining_s)
    if coasting.after(speed, remaining_s) < MIN_MPS:
        return distance_m / remaining_s
    return speed

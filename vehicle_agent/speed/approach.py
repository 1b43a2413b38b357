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
from dataclasses import dataclass

from vehicle_agent.signals import Green
from vehicle_agent.speed.coasting import CoastingModel


@dataclass(frozen=True)
class Margins:
    """How carefully signals are approached.

    Attributes:
        certain_s: between the begin of a green that is fixed and the arrival, and between the
            platoon's last vehicle and the end.
        uncertain_s: of a green whose begin is the earliest one.
        min_mps: no slower approach than this; who would have to be slower stops at the line.
        queued_s: what each vehicle that waits at the line needs to get away.
    """

    certain_s: float = 1.5
    uncertain_s: float = 3.0
    min_mps: float = 5.0
    queued_s: float = 2.0


def choose_arrival_s(
    greens: Iterable[Green],
    now_s: float,
    earliest_s: float,
    tail_s: float,
    queue: int,
    margins: Margins,
) -> float | None:
    """The earliest time to reach a signal at: `earliest_s`, unhindered, if it can pass then; a
    later time in a green; None if nothing is known of the next green that it can take.

    `tail_s` is from its passing to that of the last vehicle behind it that goes with it, `queue`
    how many wait at the line.
    """
    for green in greens:
        running = green.begin_s <= now_s
        margin_s = margins.certain_s if green.certain else margins.uncertain_s
        opens_s = green.begin_s + margin_s + queue * margins.queued_s
        arrive_s = earliest_s if running and not queue else max(earliest_s, opens_s)
        if not green.certain:
            # An actuated green is extended for vehicles that arrive after its earliest end.
            return arrive_s
        if arrive_s + tail_s <= green.end_s - margins.certain_s:
            return arrive_s
    return None


def arrival_speed_mps(
    coasting: CoastingModel,
    distance_m: float,
    remaining_s: float,
    min_mps: float,
) -> float | None:
    """The speed from which rolling reaches the line in time, or one speed all the way where rolling
    would end below the least; None: too slow, it will stop there.
    """
    if distance_m <= 0 or remaining_s <= 0:
        return None
    if distance_m / remaining_s < min_mps:
        return None
    speed = coasting.speed_for(distance_m, remaining_s)
    if coasting.after(speed, remaining_s) < min_mps:
        return distance_m / remaining_s
    return speed

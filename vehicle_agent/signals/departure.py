"""The departure second of a leg: the one with the least cost through the signals.

Each of some seconds is tried out on what is broadcast: the whole leg where signals have fixed
times, the first signals where they are actuated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from slipstream.energy.traction import JOULE_PER_KWH, PAPER_CAR, VehicleParameters
from slipstream.messages import DrivingAdvice
from vehicle_agent.leg import Leg
from vehicle_agent.signals.predicted_drive import (
    YIELDING_MPS,
    Greens,
    Movement,
    RoadPart,
    predict_drive,
)
from vehicle_agent.signals.timings import Green, SignalTimings

_STEP_S: Final = 4.0
_MAX_CANDIDATES: Final = 9
DEPARTURE_WINDOW_S: Final = _STEP_S * (_MAX_CANDIDATES - 1)
"""From the first second that is tried to the last."""
_PACES: Final = (0.94, 0.97, 1.0)
"""Shares of the limit, each tried: a choice that one vehicle ahead can spoil is worth less than one
that holds for all."""
_MAX_LEG_S: Final = 1800.0


class LegDeparture:
    """Chooses the departure of one vehicle's legs by the signals' timing, as far as it is known."""

    def __init__(self, timings: SignalTimings, vehicle: VehicleParameters = PAPER_CAR) -> None:
        self._timings, self._vehicle = timings, vehicle
        self._decided: tuple[Leg, int] | None = None

    def second_ns(self, leg: Leg, advice: DrivingAdvice, now_ns: int, slack_ns: int) -> int:
        """When a leg that is due begins, UTC, by `slack_ns` later at most; the same until another
        leg is due.

        A vehicle that is planned in a platoon keeps to its plan. Waiting has the value of driving
        time.
        """
        if self._decided is None or self._decided[0] is not leg:
            self._decided = leg, self._choose(leg, advice, now_ns, slack_ns)
        return self._decided[1]

    def _choose(self, leg: Leg, advice: DrivingAdvice, now_ns: int, slack_ns: int) -> int:
        window_s, price_kw = min(advice.departure_window_s, slack_ns / 1e9), advice.value_of_time_kw
        planned = any(segment.platoon is not None for segment in leg.planned)
        if window_s <= 0 or price_kw is None or planned:
            return now_ns
        now_s, value_w = now_ns / 1e9, 1000 * price_kw
        return round(self.best_s(leg, now_s, now_s + window_s, value_w) * 1e9)

    def best_s(self, leg: Leg, now_s: float, latest_s: float, value_of_time_w: float) -> float:
        """When to leave: the first of the best seconds between now and the latest one."""
        seconds = [now_s + _STEP_S * i for i in range(_MAX_CANDIDATES)]
        tried = [second for second in seconds if second <= latest_s]
        if len(tried) <= 1:
            return now_s
        ways = [way_of(leg, pace) for pace in _PACES]
        greens = self._greens(now_s, tried[-1] - now_s)

        def price_kwh(second_s: float) -> float:
            drives = [predict_drive(way, second_s, greens, self._vehicle) for way in ways]
            energy_kwh = sum(drive.energy_kwh for drive in drives) / len(drives)
            driving_s = sum(drive.duration_s for drive in drives) / len(drives)
            time_j = value_of_time_w * driving_s + value_of_time_w * (second_s - now_s)
            # Rounded, so that the first of equals wins.
            return round(energy_kwh + time_j / JOULE_PER_KWH, 9)

        return min(tried, key=lambda second: (price_kwh(second), second))

    def _greens(self, now_s: float, latest_s: float) -> Greens:
        """What is known of movements now, for drives that begin within some seconds."""
        known: dict[Movement, Sequence[Green]] = {}
        ahead_s = latest_s + _MAX_LEG_S

        def greens(movement: Movement) -> Sequence[Green]:
            if movement not in known:
                known[movement] = self._timings.predicted(*movement, now_s, ahead_s)
            return known[movement]

        return greens


def way_of(leg: Leg, pace: float) -> tuple[RoadPart, ...]:
    """The stretches of a leg at a share of its limits: segments and, between them, junctions."""
    lines = {line.number: line for line in leg.lines}
    limits = leg.limits_mps
    found: list[RoadPart] = []
    for number, segment in enumerate(leg.planned[:-1]):
        crossing, line = segment.crossing, lines.get(number)
        movement = None if line is None else Movement(line.intersection, line.group(None))
        yields = crossing is not None and crossing.yields
        end_mps = YIELDING_MPS if yields else math.inf
        found.append(RoadPart(leg.lengths_m[number], pace * limits[number], movement, end_mps))
        if crossing is not None:
            speed = min(crossing.speed_mps, pace * limits[number + 1])
            found.append(RoadPart(crossing.length_m, speed))
    found.append(RoadPart(leg.lengths_m[-1], pace * limits[-1]))
    return tuple(found)

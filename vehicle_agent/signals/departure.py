"""The departure second of a leg: the one with the least cost through the signals.

A vehicle that stands at its depot or at a customer's costs nothing by standing a little longer, if
its deliveries stay in time. Each of some seconds is tried out on what is broadcast: the whole leg
where signals have fixed times, the first signals where they are actuated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from slipstream.energy.traction import JOULE_PER_KWH, PAPER_CAR, VehicleParameters
from vehicle_agent.leg import Leg
from vehicle_agent.signals.predicted_drive import (
    DriveParameters,
    Greens,
    Movement,
    PredictedDrive,
    RoadPart,
    predict_drive,
)
from vehicle_agent.signals.timings import Green, SignalTimings


@dataclass(frozen=True)
class DepartureSettings:
    """Choice of the departure second.

    Attributes:
        step_s: between the seconds that are tried.
        value_of_time_w: of travel time.
        value_of_waiting_w: of time before the departure; 0 where waiting is free.
        paces: share of the speed that traffic allows, each tried: a choice that one vehicle ahead
            can spoil is worth less than one that holds for all.
        max_leg_s: that a leg can last, for how far timing is looked up.
    """

    step_s: float = 4.0
    max_candidates: int = 9
    value_of_time_w: float = 3000.0
    value_of_waiting_w: float = 0.0
    paces: tuple[float, ...] = (0.94, 0.97, 1.0)
    max_leg_s: float = 1800.0
    parameters: DriveParameters = field(default_factory=DriveParameters)

    @property
    def window_s(self) -> float:
        """From the first second that is tried to the last."""
        return self.step_s * (self.max_candidates - 1)

    def __post_init__(self) -> None:
        if (
            self.step_s <= 0
            or self.max_candidates < 1
            or min(self.value_of_time_w, self.value_of_waiting_w) < 0
        ):
            raise ValueError(
                "step_s and max_candidates must be > 0, value_of_time_w and value_of_waiting_w >= 0"
            )
        if not self.paces or any(not 0 < pace <= 1 for pace in self.paces):
            raise ValueError("paces must be in (0, 1]")


class DepartureOptimizer:
    """Chooses departure seconds by what intersections tell of their signals."""

    def __init__(
        self,
        timings: SignalTimings,
        settings: DepartureSettings | None = None,
        vehicle: VehicleParameters = PAPER_CAR,
    ) -> None:
        self._timings = timings
        self._settings = settings or DepartureSettings()
        self._vehicle = vehicle

    def best_second(
        self,
        leg: Leg,
        now_s: float,
        latest_s: float,
        speeds_mps: Sequence[float] | None = None,
    ) -> float:
        """When to leave, UTC or simulated: the first of the best seconds between now and the latest
        one. `speeds_mps` is what traffic allows on each segment; the limit if not given.
        """
        settings = self._settings
        seconds = [now_s + settings.step_s * i for i in range(settings.max_candidates)]
        tried = [second for second in seconds if second <= latest_s]
        if len(tried) <= 1:
            return now_s
        ways = [self.way(leg, speeds_mps, pace) for pace in settings.paces]
        greens = self._greens(now_s, tried[-1] - now_s)

        def price_kwh(second_s: float) -> float:
            predictions = [self._predict(way, second_s, greens) for way in ways]
            energy_kwh = sum(o.energy_kwh for o in predictions) / len(predictions)
            driving_s = sum(o.duration_s for o in predictions) / len(predictions)
            time_j = settings.value_of_time_w * driving_s + settings.value_of_waiting_w * (
                second_s - now_s
            )
            # Rounded, so that the first of equals wins.
            return round(energy_kwh + time_j / JOULE_PER_KWH, 9)

        return min(tried, key=lambda second: (price_kwh(second), second))

    def predict(
        self,
        leg: Leg,
        depart_s: float,
        now_s: float,
        speeds_mps: Sequence[float] | None = None,
        pace: float = 1.0,
    ) -> PredictedDrive:
        """What a leg is expected to take and need if it begins at a second, at a share `pace` of
        the speeds.
        """
        way = self.way(leg, speeds_mps, pace)
        return self._predict(way, depart_s, self._greens(now_s, depart_s - now_s))

    def way(
        self, leg: Leg, speeds_mps: Sequence[float] | None = None, pace: float = 1.0
    ) -> tuple[RoadPart, ...]:
        """The stretches of a leg: its segments and, between them, the junctions."""
        speeds = speeds_mps or leg.limits_mps
        lines = {line.number: line for line in leg.lines}
        found: list[RoadPart] = []
        for number, segment in enumerate(leg.planned[:-1]):
            crossing, line = segment.crossing, lines.get(number)
            movement = None if line is None else Movement(line.intersection, line.group(None))
            yields = crossing is not None and crossing.yields
            end_mps = self._settings.parameters.yielding_mps if yields else math.inf
            length_m = leg.lengths_m[number]
            found.append(RoadPart(length_m, pace * speeds[number], movement, end_mps))
            if crossing is not None:
                speed = min(crossing.speed_mps, pace * leg.limits_mps[number + 1])
                found.append(RoadPart(crossing.length_m, speed))
        found.append(RoadPart(leg.lengths_m[-1], pace * speeds[-1]))
        return tuple(found)

    def _predict(self, way: Sequence[RoadPart], depart_s: float, greens: Greens) -> PredictedDrive:
        return predict_drive(way, depart_s, greens, self._settings.parameters, self._vehicle)

    def _greens(self, now_s: float, latest_s: float) -> Greens:
        """What is known of movements now, for drives that begin within some seconds."""
        known: dict[Movement, tuple[Green, ...]] = {}
        ahead_s = latest_s + self._settings.max_leg_s

        def greens(movement: Movement) -> tuple[Green, ...]:
            found = known.get(movement)
            if found is None:
                found = self._timings.predicted(*movement, now_s, ahead_s)
                known[movement] = found
            return found

        return greens

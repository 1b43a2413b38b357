"""The departure second of a leg: the one with the least cost through the signals.

A vehicle that stands at its depot or at a customer's costs nothing by standing a little longer, if
its deliveries stay in time. Each of some seconds is tried out on what is broadcast: the whole leg
where signals have fixed times, the first signals where they are actuated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from simulation.controllers.signals.crossings import Link, Movements
from simulation.controllers.signals.predicted_drive import (
    DriveParameters,
    Greens,
    PredictedDrive,
    RoadPart,
    predict_drive,
)
from simulation.controllers.signals.program import Green
from simulation.controllers.signals.timing import Signals
from slipstream.energy import JOULE_PER_KWH, PAPER_CAR, VehicleParameters


@dataclass(frozen=True)
class DepartureSettings:
    """Choice of the departure second.

    Attributes:
        step_s: between the seconds that are tried.
        max_candidates: how many are tried.
        value_of_time_w: of travel time.
        value_of_waiting_w: of time before the departure; 0 where waiting is free.
        paces: share of the speed that traffic allows, each tried: a choice that one vehicle ahead
            can spoil is worth less than one that holds for all.
        max_leg_s: that a leg can last, for how far timing is looked up.
        parameters: of driving.
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
    """Chooses departure seconds by the signal timing of the running simulation.

    Args:
        signals: their timing.
        movements: of the net; read from the running simulation if not given.
        settings: of the choice.
        vehicle: physical data.
    """

    def __init__(
        self,
        signals: Signals,
        movements: Movements | None = None,
        settings: DepartureSettings | None = None,
        vehicle: VehicleParameters = PAPER_CAR,
    ) -> None:
        self._signals = signals
        self._movements = movements or Movements()
        self._settings = settings or DepartureSettings()
        self._vehicle = vehicle

    def best_second(
        self,
        path: tuple[str, ...],
        now_s: float,
        latest_s: float,
        speeds_mps: Sequence[float] | None = None,
    ) -> float:
        """When to leave: the first of the best seconds between now and the latest one.

        Args:
            path: of the leg.
            now_s: simulated time.
            latest_s: when the vehicle must have left.
            speeds_mps: what traffic allows on each segment; the limit if not given.
        """
        settings = self._settings
        seconds = [now_s + settings.step_s * i for i in range(settings.max_candidates)]
        tried = [second for second in seconds if second <= latest_s]
        if len(tried) <= 1:
            return now_s
        ways = [self.way(path, speeds_mps, pace) for pace in settings.paces]
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
        path: tuple[str, ...],
        depart_s: float,
        now_s: float,
        speeds_mps: Sequence[float] | None = None,
        pace: float = 1.0,
    ) -> PredictedDrive:
        """What a leg is expected to take and need if it begins at a second.

        Args:
            path: of the leg.
            depart_s: when it begins.
            now_s: simulated time.
            speeds_mps: what traffic allows on each segment; the limit if not given.
            pace: share of these speeds.
        """
        way = self.way(path, speeds_mps, pace)
        return self._predict(way, depart_s, self._greens(now_s, depart_s - now_s))

    def way(
        self, path: tuple[str, ...], speeds_mps: Sequence[float] | None = None, pace: float = 1.0
    ) -> tuple[RoadPart, ...]:
        """The stretches of a path: its segments and, between them, the junctions."""
        movements = self._movements
        speeds = speeds_mps or [movements.limit_mps(segment) for segment in path]
        found: list[RoadPart] = []
        for number, (before, after) in enumerate(pairwise(path)):
            movement = movements.movement(before, after)
            link = next(iter(movement.links.values()), None) if movement is not None else None
            yields = movement is not None and movement.yields
            end_mps = self._settings.parameters.yielding_mps if yields else math.inf
            found.append(RoadPart(movements.length_m(before), pace * speeds[number], link, end_mps))
            if movement is not None:
                speed = min(movement.speed_mps, pace * movements.limit_mps(after))
                found.append(RoadPart(movement.length_m, speed))
        found.append(RoadPart(movements.length_m(path[-1]), pace * speeds[-1]))
        return tuple(found)

    def _predict(self, way: Sequence[RoadPart], depart_s: float, greens: Greens) -> PredictedDrive:
        return predict_drive(way, depart_s, greens, self._settings.parameters, self._vehicle)

    def _greens(self, now_s: float, latest_s: float) -> Greens:
        """What is known of movements now, for drives that begin within some seconds."""
        known: dict[Link, tuple[Green, ...]] = {}
        ahead_s = latest_s + self._settings.max_leg_s

        def greens(link: Link) -> tuple[Green, ...]:
            found = known.get(link)
            if found is None:
                found = self._signals.predicted(link.tls, link.number, now_s, ahead_s)
                known[link] = found
            return found

        return greens

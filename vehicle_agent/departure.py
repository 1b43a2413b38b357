"""The second at which the leg that comes next begins, decided once, when the leg is due."""

from __future__ import annotations

from slipstream.energy.traction import VehicleParameters
from slipstream.messages import DrivingAdvice
from vehicle_agent.leg import Leg
from vehicle_agent.signals import DepartureOptimizer, DepartureSettings, SignalTimings


class LegDeparture:
    """Chooses the departure of one vehicle's legs by the signals' timing, as far as it is known."""

    def __init__(self, timings: SignalTimings, vehicle: VehicleParameters) -> None:
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
        window_s = min(advice.departure_window_s, slack_ns / 1e9)
        if window_s <= 0 or any(segment.platoon is not None for segment in leg.planned):
            return now_ns
        value_w = 1000 * advice.value_of_time_kw
        settings = DepartureSettings(value_of_time_w=value_w, value_of_waiting_w=value_w)
        now_s = now_ns / 1e9
        optimizer = DepartureOptimizer(self._timings, settings, self._vehicle)
        return round(optimizer.best_second(leg, now_s, now_s + window_s) * 1e9)

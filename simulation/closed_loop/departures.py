"""The last look before a leg begins, and while it lasts: which way now, and at which second."""

from __future__ import annotations

from dataclasses import replace

from simulation.closed_loop.dispatching import Dispatching
from simulation.closed_loop.gates import Roadside
from simulation.closed_loop.policy import Policy
from simulation.closed_loop.tours import Rounds, free_s
from simulation.controllers import LegOrder, VehicleState
from simulation.controllers.signals import Departures, DepartureSettings, Signals
from slipstream.roads import RoadNetwork


def seconds_of(policy: Policy, signals: Signals, waiting_worth_kw: float) -> Departures | None:
    """What chooses the seconds of an arm; standing at the kerb is priced like driving."""
    if "departures" not in policy.levers:
        return None
    price_w = 1000 * waiting_worth_kw
    return Departures(signals, settings=DepartureSettings(price_w=price_w, waiting_w=price_w))


class Departing:
    """Decides when a leg is due.

    Args:
        network: roads.
        dispatching: knows what ways cost by now.
        roadside: what RSUs report.
        rounds: know how long a vehicle may wait.
        seconds: chooses the second; None: vehicles leave when they are due.
    """

    def __init__(
        self,
        network: RoadNetwork,
        dispatching: Dispatching,
        roadside: Roadside,
        rounds: Rounds,
        seconds: Departures | None,
    ) -> None:
        self._network, self._dispatching, self._roadside = network, dispatching, roadside
        self._rounds, self._seconds = rounds, seconds

    def leave(self, order: LegOrder, now_s: float) -> tuple[LegOrder, float]:
        """The leg as it is to be driven, and when to leave; once a leg, when it is due.

        Who is to drive in a platoon keeps to the plan.
        """
        if any(segment.platoon is not None for segment in order.planned):
            return order, now_s
        way = self._dispatching.ways(now_s, self._roadside).better(order.path)
        if way is not None:
            order = replace(order, path=way, free_s=free_s(self._network, way))
        window_s = order.advice.departure_window_s
        if self._seconds is None or window_s <= 0:
            return order, now_s
        latest_s = now_s + min(window_s, self._rounds.slack_s(order.vehicle, now_s))
        return order, self._seconds.best_second(order.path, now_s, latest_s)

    def other_way(
        self, order: LegOrder, state: VehicleState, now_s: float
    ) -> tuple[str, ...] | None:
        """A better way for a vehicle on the road; None if it is to stay on its own."""
        ahead = order.path[state.number :]
        if any(s.platoon is not None and s.segment in ahead for s in order.planned):
            return None
        return self._dispatching.ways(now_s, self._roadside).better(order.path, state.number)

"""The last look before a leg begins, and while it lasts: which way now, and at which second."""

from __future__ import annotations

from dataclasses import replace

from simulation.closed_loop.dispatching import Dispatching
from simulation.closed_loop.gates import Roadside
from simulation.closed_loop.policy import Policy
from simulation.closed_loop.tours import Tours, free_s
from simulation.controllers import LegOrder, VehicleState
from simulation.controllers.signals import DepartureOptimizer, DepartureSettings, Signals
from slipstream.roads import RoadNetwork


def departure_optimizer(
    policy: Policy, signals: Signals, waiting_worth_kw: float
) -> DepartureOptimizer | None:
    """What chooses the seconds of an arm; standing at the kerb is priced like driving."""
    if "departures" not in policy.levers:
        return None
    value_of_time_w = 1000 * waiting_worth_kw
    return DepartureOptimizer(
        signals,
        settings=DepartureSettings(
            value_of_time_w=value_of_time_w, value_of_waiting_w=value_of_time_w
        ),
    )


class LegDepartures:
    """Decides when a leg is due.

    Args:
        network: roads.
        dispatching: knows what ways cost by now.
        roadside: what RSUs report.
        tours: know how long a vehicle may wait.
        optimizer: chooses the second; None: vehicles leave when they are due.
    """

    def __init__(
        self,
        network: RoadNetwork,
        dispatching: Dispatching,
        roadside: Roadside,
        tours: Tours,
        optimizer: DepartureOptimizer | None,
    ) -> None:
        self._network, self._dispatching, self._roadside = network, dispatching, roadside
        self._tours, self._optimizer = tours, optimizer

    def leave(self, order: LegOrder, now_s: float) -> tuple[LegOrder, float]:
        """The leg as it is to be driven, and when to leave; once a leg, when it is due.

        Who is to drive in a platoon keeps to the plan.
        """
        if any(segment.platoon is not None for segment in order.planned):
            return order, now_s
        way = self._dispatching.alternatives(now_s, self._roadside).better(order.path)
        if way is not None:
            order = replace(order, path=way, free_s=free_s(self._network, way))
        window_s = order.advice.departure_window_s
        if self._optimizer is None or window_s <= 0:
            return order, now_s
        latest_s = now_s + min(window_s, self._tours.slack_s(order.vehicle, now_s))
        return order, self._optimizer.best_second(order.path, now_s, latest_s)

    def better_route(
        self, order: LegOrder, state: VehicleState, now_s: float
    ) -> tuple[str, ...] | None:
        """A better way for a vehicle on the road; None if it is to stay on its own."""
        ahead = order.path[state.number :]
        if any(s.platoon is not None and s.segment in ahead for s in order.planned):
            return None
        return self._dispatching.alternatives(now_s, self._roadside).better(
            order.path, state.number
        )

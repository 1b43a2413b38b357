"""Path and departure second of a leg just before it begins, and its path while it lasts."""

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
    """The departure optimizer of an arm; waiting at the kerb has the value of driving time."""
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
    """Decides on the path and the departure of legs.

    Args:
        network: roads.
        dispatching: has the present costs of paths.
        roadside: has the RSUs' reports.
        tours: have the slack of each vehicle.
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
        """The leg to drive and its departure time; called once a leg, when it is due.

        A vehicle that is planned in a platoon keeps to its plan.
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
        """A better path for a vehicle on the road; None: it keeps its path."""
        ahead = order.path[state.number :]
        if any(s.platoon is not None and s.segment in ahead for s in order.planned):
            return None
        return self._dispatching.alternatives(now_s, self._roadside).better(
            order.path, state.number
        )

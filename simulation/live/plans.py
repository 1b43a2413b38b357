"""From the dispatcher's plans to tours of the simulated fleet."""

from __future__ import annotations

import queue
from collections.abc import Collection, Iterator, Mapping

from slipstream.errors import InputError
from slipstream.messages import VehiclePlan, decode


def in_world_time(plan: VehiclePlan, issued_s: float) -> VehiclePlan:
    """The plan with its times in ns of simulated time since midnight.

    A plan's times count from its issue in simulated seconds, at any speed of the world: its driving
    times are those of the roads.

    Args:
        issued_s: simulated time that it was issued at.
    """
    shift_ns = round(issued_s * 1e9) - plan.issued_ns

    def moved(time_ns: int) -> int:
        return max(0, time_ns + shift_ns)

    return plan.model_copy(
        update={
            "issued_ns": moved(plan.issued_ns),
            "valid_until_ns": moved(plan.valid_until_ns),
            "depart_ns": moved(plan.depart_ns),
            "stops": tuple(
                stop.model_copy(
                    update={
                        "arrival_ns": moved(stop.arrival_ns),
                        "departure_ns": moved(stop.departure_ns),
                    }
                )
                for stop in plan.stops
            ),
            "segments": tuple(
                part.model_copy(
                    update={"entry_ns": moved(part.entry_ns), "exit_ns": moved(part.exit_ns)}
                )
                for part in plan.segments
            ),
        }
    )


class PlanQueue:
    """Plans from the bus's thread to the simulation's."""

    def __init__(self, vehicles: Collection[str]) -> None:
        self._vehicles = frozenset(vehicles)
        self._plans: queue.SimpleQueue[VehiclePlan] = queue.SimpleQueue()

    def take(self, key: str, payload: bytes) -> None:
        """A message from `ALL_PLANS`; what is no plan, or for another fleet, is left out."""
        try:
            plan = decode(VehiclePlan, payload, key)
        except InputError:
            return
        if plan.vehicle in self._vehicles:
            self._plans.put(plan)

    def drain(self) -> Iterator[VehiclePlan]:
        """Plans received since the last call."""
        while True:
            try:
                yield self._plans.get_nowait()
            except queue.Empty:
                return


class PendingPlans:
    """Plans that have come, by vehicle, until it is free to follow one.

    A vehicle on its tour finishes it first. One at its depot takes the newest plan, unless its
    departure had passed before the vehicle was back, or another vehicle has taken one of its
    orders: then it waits for the next plan.
    """

    def __init__(self, vehicles: Collection[str], orders: Collection[str]) -> None:
        self._vehicles, self._orders = frozenset(vehicles), frozenset(orders)
        self._newest: dict[str, VehiclePlan] = {}

    def add(self, plan: VehiclePlan) -> None:
        """A plan has come, its times in simulated ns; one of another fleet is ignored."""
        known = all(order in self._orders for order in _orders_of(plan))
        if plan.vehicle in self._vehicles and known and plan.segments:
            self._newest[plan.vehicle] = plan

    def take(self, idle: Mapping[str, float], taken: Collection[str]) -> Iterator[VehiclePlan]:
        """The plans to follow now; each is handed out once.

        Args:
            idle: since when each free vehicle is at its depot, s; may change in between.
            taken: orders that are served or on their way; may change in between.
        """
        for vehicle in sorted(self._newest.keys() & idle.keys()):
            plan = self._newest.pop(vehicle)
            in_time = plan.depart_ns >= idle[vehicle] * 1e9
            if in_time and not any(order in taken for order in _orders_of(plan)):
                yield plan


def _orders_of(plan: VehiclePlan) -> list[str]:
    """The plan's stops but for the depot at both ends."""
    return [stop.stop for stop in plan.stops[1:-1]]

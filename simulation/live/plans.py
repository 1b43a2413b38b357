"""From the dispatcher's plans to rounds of the simulated fleet."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from slipstream.messages import VehiclePlan


def in_world_time(plan: VehiclePlan, issued_s: float) -> VehiclePlan:
    """The plan with its times in ns of simulated time since midnight.

    A plan's times count from its issue in simulated seconds, however fast the world runs: what it
    tells of a drive's length is true of the roads.

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


class Waiting:
    """Plans that have come, by vehicle, until it is free to follow one.

    A vehicle on its round finishes it first. One at its depot takes the newest plan, unless that
    plan's departure had passed before the vehicle was back: it waits for the next one.
    """

    def __init__(self, vehicles: Collection[str], orders: Collection[str]) -> None:
        self._vehicles, self._orders = frozenset(vehicles), frozenset(orders)
        self._newest: dict[str, VehiclePlan] = {}

    def add(self, plan: VehiclePlan) -> None:
        """A plan has come, its times in simulated ns; one of another fleet is ignored."""
        known = all(stop.stop in self._orders for stop in plan.stops[1:-1])
        if plan.vehicle in self._vehicles and known and plan.segments:
            self._newest[plan.vehicle] = plan

    def take(self, idle: Mapping[str, float]) -> Iterator[VehiclePlan]:
        """The plans to follow now; each is handed out once.

        Args:
            idle: since when each free vehicle is at its depot, s.
        """
        for vehicle in sorted(self._newest.keys() & idle.keys()):
            plan = self._newest.pop(vehicle)
            if plan.depart_ns >= idle[vehicle] * 1e9:
                yield plan

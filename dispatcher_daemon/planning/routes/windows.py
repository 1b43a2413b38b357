"""Time windows of departures: when vehicles may leave, and where bound ones are by their plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from dispatcher_daemon.fleet import Commitment
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads import Route, Travel
from dispatcher_daemon.planning.routes.continuing import departure_s, planned_waits_s

MAX_WAIT_S: Final = 600.0
"""Longest wait at one stop: nobody foresees traffic much further."""


class Windows:
    """When each vehicle of one fleet may leave.

    Args:
        travels: the first has the ways that present plans were made with.

    Attributes:
        reference_s: when a vehicle that is ready at once leaves.
        bound: commitments by the numbers of their vehicles.
    """

    def __init__(
        self,
        problem: RoutingProblem,
        now_ns: int,
        travels: Sequence[Travel],
        reference_s: float,
        commitments: Sequence[Commitment],
    ) -> None:
        self._problem, self._now_ns, self._travels = problem, now_ns, travels
        self.reference_s = reference_s
        by_vehicle = {own.vehicle: own for own in commitments}
        self.bound: Mapping[int, Commitment] = {
            number: by_vehicle[vehicle.id]
            for number, vehicle in enumerate(problem.fleet.vehicles)
            if vehicle.id in by_vehicle
        }

    def of(self, number: int) -> tuple[float, float]:
        """First and last departure; of a bound vehicle its place, where it may stay for others."""
        own = self.bound.get(number)
        if own is not None and own.may_wait and self._problem.waits_on_tours:
            ends_s = 1e-9 * (own.ends_ns - self._now_ns)
            # Its new plan has to be out.
            first_s = max(ends_s, self.reference_s)
            return first_s, max(first_s, ends_s + MAX_WAIT_S, self.planned_departure_s(number))
        if own is not None:
            begins_s = self.planned_departure_s(number)
            return begins_s, begins_s
        vehicle = self._problem.fleet.vehicles[number]
        latest = vehicle.ready_s if vehicle.depart_by_s is None else vehicle.depart_by_s
        return self.reference_s + vehicle.ready_s, self.reference_s + latest

    def planned_departure_s(self, number: int) -> float:
        """When the committed part of a bound vehicle's route begins by its present plan."""
        travel = self._travels[0].of(self._problem.fleet.vehicles[number])
        return departure_s(self.bound[number], travel.roads, self._now_ns)

    def planned_waits_s(self, number: int, route: Route) -> tuple[float, ...]:
        """Waits of a vehicle's present plan on a route without any; none of a free vehicle."""
        own = self.bound.get(number)
        if own is None:
            return ()
        return planned_waits_s(self._problem, own, route, self._now_ns, self.reference_s)

    def standing_first(self, number: int, route: Route) -> Route:
        """A bound vehicle's route from where it stands, with its wait there, or it would leave."""
        own, here = self.bound[number], route.visits[0]
        if own.moving is not None or not own.under_way:
            return route
        if own.departs_ns <= own.ends_ns and not own.may_wait:
            return route
        ready_s = max(0.0, 1e-9 * (own.ends_ns - self._now_ns))
        wait_s = max(0.0, here.departure_s - ready_s)
        here = replace(here, arrival_s=here.departure_s - wait_s, wait_s=wait_s)
        return replace(route, visits=(here, *route.visits[1:]))

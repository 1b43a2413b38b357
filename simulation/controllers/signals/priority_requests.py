"""Priority requests: vehicles whose free drive to a stop line is short enough."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import libsumo

from simulation.controllers.signals.crossings import Crossing, Movements
from simulation.controllers.signals.priority_rules import PrioritySettings
from simulation.controllers.signals.timing import Signals
from simulation.controllers.vehicle import LegOrder, VehicleState, free_drive_s


@dataclass
class Request:
    """A vehicle before a signal.

    Attributes:
        vehicle: that requests.
        tls: the signal.
        crossing: number of its segment in the vehicle's path.
        link: number of its movement at the signal.
        first_s: time of its first request.
        wanted_s: latest begin of green at which it need not brake.
        through_s: when it and its followers have passed the stop line.
        served: whether the signal changed its times for it.
    """

    vehicle: str
    tls: str
    crossing: int
    link: int
    first_s: float
    wanted_s: float = 0.0
    through_s: float = 0.0
    served: bool = False


@dataclass(frozen=True)
class _Route:
    path: tuple[str, ...]
    begins_m: tuple[float, ...]
    crossings: tuple[Crossing, ...]


class PriorityRequests:
    """The open requests of a running simulation.

    Args:
        signals: of it.
        movements: of its net.
        settings: when a vehicle asks.
    """

    def __init__(self, signals: Signals, movements: Movements, settings: PrioritySettings) -> None:
        self._signals, self._movements, self._settings = signals, movements, settings
        self._routes: dict[str, _Route] = {}
        self._open: dict[str, dict[str, Request]] = {}

    def departed(self, name: str, order: LegOrder) -> None:
        """A vehicle entered the road, or was rerouted on it."""
        movements = self._movements
        self._open.pop(name, None)
        self._routes[name] = _Route(
            order.path, movements.begins_m(order.path), movements.crossings(order.path)
        )

    def ended(self, name: str) -> None:
        """A vehicle is off the road."""
        self._open.pop(name, None)
        self._routes.pop(name, None)

    def at_signals(
        self, now_s: float, states: Mapping[str, VehicleState], tails_m: Mapping[str, float]
    ) -> dict[str, list[Request]]:
        """The requests at each signal, those that were first to ask first.

        Args:
            now_s: simulated time.
            states: of the vehicles on the road.
            tails_m: from a leader's front to the end of its platoon.
        """
        found: dict[str, list[Request]] = {}
        for name, route in self._routes.items():
            state = states.get(name)
            if state is None:
                continue
            known = self._open.get(name, {})
            asking: dict[str, Request] = {}
            for crossing, arrival_s in self._ahead(route, state, now_s):
                link = crossing.link(state.lane if crossing.number == state.number else -1)
                request = known.get(crossing.tls)
                if request is None or request.crossing != crossing.number:
                    request = Request(name, crossing.tls, crossing.number, link, now_s)
                self._update(request, link, arrival_s, route, tails_m.get(name, 0.0))
                asking[crossing.tls] = request
                found.setdefault(crossing.tls, []).append(request)
            self._open[name] = asking
        for group in found.values():
            group.sort(key=lambda request: (request.first_s, request.vehicle))
        return found

    def _ahead(
        self, route: _Route, state: VehicleState, now_s: float
    ) -> Iterator[tuple[Crossing, float]]:
        """Signals in reach and when the vehicle can be there, up to the first that is not green."""
        place_m = route.begins_m[state.number] + state.front_m
        if state.crossing:
            place_m += self._movements.length_m(route.path[state.number])
        passed = state.number + state.crossing
        limit_mps = self._movements.limit_mps(route.path[state.number])
        reach_m = self._settings.horizon_s * max(limit_mps, state.speed_mps)
        for crossing in route.crossings:
            if crossing.number < passed:
                continue
            distance_m = crossing.line_m - place_m
            if distance_m > reach_m:
                return
            drive_s = free_drive_s(max(distance_m, 0.0), state.speed_mps, limit_mps)
            if drive_s > self._settings.horizon_s:
                return
            yield crossing, now_s + drive_s
            running = self._signals.running(crossing.tls, now_s)
            if not running.program.phases[running.phase].allows(crossing.link(-1)):
                return

    def _update(
        self, request: Request, link: int, arrival_s: float, route: _Route, tail_m: float
    ) -> None:
        settings = self._settings
        segment = route.path[request.crossing]
        standing = libsumo.edge.getLastStepHaltingNumber(segment)
        lanes = max(1, libsumo.edge.getLaneNumber(segment))
        request.link = link
        request.wanted_s = arrival_s - settings.lead_s - settings.queue_s * standing / lanes
        request.through_s = arrival_s + settings.passing_s + tail_m / settings.passing_mps

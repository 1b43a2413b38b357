"""The fleet's vehicles in the running simulation: insertion, measurement, removal at rest."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

from simulation.closed_loop.losses import losses
from simulation.closed_loop.record import DrivenLeg
from simulation.controllers import SPEED_CHECKS, LegOrder, VehicleState, read_state
from simulation.controllers.fleet_controller import Drafting, VehicleController
from simulation.sumo.session import Session
from slipstream.energy import ETA_ALONE, ETA_FOLLOWER, PAPER_CAR, VehicleParameters, trace_energy

Leave = Callable[[LegOrder, float], tuple[LegOrder, float]]

_STANDING_MPS: Final = 0.1
_ROLLING_MPS: Final = 1.0
# The IDM approaches the end of a leg asymptotically: the last metres would take minutes.
_ARRIVED_M: Final = 5.0
_ARRIVED_MPS: Final = 1.0


@dataclass
class _OnRoad:
    """A vehicle on the road with its measurements so far."""

    order: LegOrder
    departed_s: float
    state: VehicleState
    speeds_mps: list[float] = field(default_factory=lambda: [0.0])
    eta: list[float] = field(default_factory=list)
    led_m: float = 0.0
    followed_m: float = 0.0
    stops: int = 0
    waited_s: float = 0.0
    turbulent_s: float = 0.0
    moved: bool = False
    behind: int = 0

    def take(self, state: VehicleState, drafting: Drafting, step_s: float) -> None:
        """Add the measurements of a step."""
        name, way_m = self.order.id, state.driven_m - self.state.driven_m
        eta = drafting.eta.get(name, ETA_ALONE)
        if eta >= ETA_FOLLOWER:
            self.followed_m += way_m
        elif eta > 0:
            self.led_m += way_m
        self.turbulent_s += step_s if name in drafting.turbulent else 0.0
        self.speeds_mps.append(state.speed_mps)
        self.eta.append(eta)
        self.state = state
        if state.speed_mps < _STANDING_MPS:
            self.waited_s += step_s
            self.stops += self.moved
            self.moved = False
        elif state.speed_mps > _ROLLING_MPS:
            self.moved = True


class FleetWorld:
    """A simulation with the fleet in it.

    Args:
        session: running.
        lengths_m: of the network's segments.
        controller: of the vehicles.
        step_s: of the simulation.
        pace: desired speed of the fleet's vehicles over the limit.
        leave: called once for each leg when it is due; the leg to drive and its departure time.
        vehicle: whose energy is counted.
    """

    def __init__(
        self,
        session: Session,
        lengths_m: dict[str, float],
        controller: VehicleController,
        step_s: float,
        pace: float = 1.0,
        leave: Leave | None = None,
        vehicle: VehicleParameters = PAPER_CAR,
    ) -> None:
        self._session, self._lengths_m, self._controller = session, lengths_m, controller
        self._step_s, self._pace, self._vehicle = step_s, pace, vehicle
        self._due: list[tuple[float, str, LegOrder]] = []
        self._leave: Leave = leave or (lambda order, now_s: (order, now_s))
        self._decided: set[str] = set()
        self._entering: dict[str, LegOrder] = {}
        self._on_road: dict[str, _OnRoad] = {}

    @property
    def unfinished(self) -> int:
        """Vehicles on the road, or waiting to get onto it."""
        return len(self._on_road) + len(self._entering)

    def running(self) -> dict[str, tuple[LegOrder, VehicleState]]:
        """The vehicles on the road, by SUMO's id."""
        return {name: (own.order, own.state) for name, own in self._on_road.items()}

    def send(self, order: LegOrder) -> None:
        """Insert a vehicle when it is due; at once if that time has passed."""
        heapq.heappush(self._due, (order.due_s, order.id, order))

    def reroute(self, name: str, path: tuple[str, ...]) -> bool:
        """Give a vehicle on the road another path to the same place; False in a junction.

        Args:
            path: from the leg's begin, the same as before as far as the vehicle has come.
        """
        import libsumo

        own = self._on_road[name]
        if own.state.crossing or libsumo.vehicle.getRoadID(name).startswith(":"):
            return False
        number = own.state.number
        self._session.run(lambda: libsumo.vehicle.setRoute(name, list(path[number:])))
        # SUMO may keep the driven segments; both paths end at the same place.
        own.behind = len(path) - len(libsumo.vehicle.getRoute(name))
        own.order = replace(own.order, path=path)
        self._controller.departed(name, own.order)
        return True

    def step(self) -> list[DrivenLeg]:
        """Move by one step; the legs that ended in it.

        Raises:
            InputError: SUMO refuses a vehicle or a route.
        """
        import libsumo

        now_s = self._session.time_s
        self._enter(now_s)
        drafting = self._controller.control(
            now_s, {name: own.state for name, own in self._on_road.items()}
        )
        self._session.advance()
        after_s = self._session.time_s
        gone = set(libsumo.simulation.getArrivedIDList())
        ended = []
        for name in list(self._on_road):
            own = self._on_road[name]
            if name not in gone:
                own.take(read_state(name, own.order, own.behind), drafting, self._step_s)
                if self._has_arrived(own):
                    libsumo.vehicle.remove(name)
                    ended.append(self._end(name, after_s))
            else:
                ended.append(self._end(name, after_s))
        for name in libsumo.simulation.getDepartedIDList() if self._entering else ():
            order = self._entering.pop(name, None)
            if order is None:
                continue
            self._on_road[name] = _OnRoad(order, after_s, read_state(name, order))
            self._controller.departed(name, order)
        return ended

    def _enter(self, now_s: float) -> None:
        import libsumo

        while self._due and self._due[0][0] <= now_s:
            order = heapq.heappop(self._due)[2]
            name = order.id
            if name not in self._decided:
                order, leave_s = self._leave(order, now_s)
                if leave_s > now_s:
                    self._decided.add(name)
                    heapq.heappush(self._due, (leave_s, name, order))
                    continue
            self._decided.discard(name)

            def add(name: str = name, order: LegOrder = order) -> None:
                libsumo.route.add(name, list(order.path))
                libsumo.vehicle.add(
                    name,
                    name,
                    typeID="cav",
                    depart="now",
                    departLane="best",
                    departPos="base",
                    departSpeed="0",
                    arrivalSpeed="0",
                )
                libsumo.vehicle.setSpeedFactor(name, self._pace)
                libsumo.vehicle.setSpeedMode(name, SPEED_CHECKS)

            self._session.run(add)
            self._entering[name] = order

    def _has_arrived(self, own: _OnRoad) -> bool:
        state, path = own.state, own.order.path
        if state.number < len(path) - 1 or state.crossing or state.speed_mps > _ARRIVED_MPS:
            return False
        return self._lengths_m[path[-1]] - state.front_m < _ARRIVED_M

    def _end(self, name: str, now_s: float) -> DrivenLeg:
        own = self._on_road.pop(name)
        self._controller.ended(name)
        order = own.order
        # It comes to rest in the step in which it is taken off.
        speeds, eta = [*own.speeds_mps, 0.0], [*own.eta, ETA_ALONE]
        return DrivenLeg(
            vehicle=order.vehicle,
            round=order.round,
            leg=order.leg,
            ready_s=order.ready_s,
            due_s=order.due_s,
            departed_s=own.departed_s,
            arrived_s=now_s,
            free_s=order.free_s,
            distance_m=own.state.driven_m,
            driven=trace_energy(speeds, self._step_s, eta, self._vehicle),
            alone=trace_energy(speeds, self._step_s, ETA_ALONE, self._vehicle),
            led_m=own.led_m,
            followed_m=own.followed_m,
            stops=own.stops,
            waited_s=own.waited_s,
            turbulent_s=own.turbulent_s,
            path=order.path,
            losses=losses(speeds, self._step_s, self._vehicle),
        )

"""The simulated fleet: plans become drives, drives become positions."""

from __future__ import annotations

from collections.abc import Iterator

from simulation.closed_loop.tours import Tours
from simulation.closed_loop.world import FleetWorld
from simulation.controllers import LegOrder
from simulation.controllers.fleet_controller import VehicleController
from simulation.live.fleet_file import open_since_s
from simulation.live.plans import PendingPlans
from simulation.scenarios.demand import Deliveries
from simulation.sumo.session import Session
from slipstream.messages import VehiclePlan, VehiclePosition
from slipstream.roads import RoadNetwork


class LiveFleet:
    """The vehicles of a fleet in a running simulation, driven by plans as they come.

    Attributes:
        tours: of the vehicles.
        begun: tours.
        finished: of them, back at the depot.
        legs: driven.
        driven_m: of all legs driven.
        driven: vehicles that have come onto the road.
    """

    def __init__(
        self,
        session: Session,
        deliveries: Deliveries,
        network: RoadNetwork,
        controller: VehicleController,
        step_s: float,
        now_s: float,
    ) -> None:
        self._network = network
        lengths_m = {name: segment.length_m for name, segment in network.segments.items()}
        self._world = FleetWorld(session, lengths_m, controller, step_s)
        self.tours = Tours(deliveries, network)
        self.tours.skip_before(open_since_s(deliveries, now_s))
        self.tours.idle = dict.fromkeys(deliveries.vehicles, now_s)
        self._waiting = PendingPlans(deliveries.vehicles, [order.id for order in deliveries.orders])
        self._cycle: dict[str, int] = {}
        self._sent: dict[str, LegOrder] = {}
        self.begun = self.finished = self.legs = 0
        self.driven_m = 0.0
        self.driven: set[str] = set()

    @property
    def on_road(self) -> int:
        """Vehicles on a leg."""
        return len(self._world.running())

    def plan(self, plan: VehiclePlan) -> None:
        """A plan has come, its times in simulated ns."""
        self._waiting.add(plan)

    def step(self) -> None:
        """Move the simulation by one step.

        Raises:
            InputError: SUMO refuses a vehicle or a route.
        """
        for plan in self._waiting.take(self.tours.idle, self.tours.taken):
            self._cycle[plan.vehicle] = plan.cycle
            self.begun += 1
            self._send(self.tours.begin(plan))
        for leg in self._world.step():
            self.legs += 1
            self.driven_m += leg.distance_m
            self.driven.add(leg.vehicle)
            self._send(self.tours.arrived(leg))
            if leg.vehicle in self.tours.idle:
                self.finished += 1
                del self._cycle[leg.vehicle]

    def positions(self, time_ns: int) -> Iterator[VehiclePosition]:
        """Where the vehicles are; one that has had no plan yet is not heard of.

        Args:
            time_ns: UTC now.
        """
        running = {order.vehicle: state for order, state in self._world.running().values()}
        self.driven |= running.keys()
        for vehicle, order in sorted(self._sent.items()):
            state = running.get(vehicle)
            cycle = self._cycle.get(vehicle)
            if state is not None:
                length_m = self._network.segments[state.segment].length_m
                share = 1.0 if state.crossing else min(1.0, max(0.0, state.front_m / length_m))
                where, speed_mps = state.segment, max(0.0, state.speed_mps)
            else:
                # Before a leg it stands at its beginning; after the last one at its end.
                where, share = (order.path[0], 0.0) if cycle is not None else (order.path[-1], 1.0)
                speed_mps = 0.0
            yield VehiclePosition(
                vehicle=vehicle,
                time_ns=time_ns,
                segment=where,
                share=share,
                speed_mps=speed_mps,
                on_road=state is not None,
                cycle=cycle,
                leg=None if cycle is None else order.leg,
            )

    def _send(self, orders: Iterator[LegOrder]) -> None:
        for order in orders:
            self._sent[order.vehicle] = order
            self._world.send(order)

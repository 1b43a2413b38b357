"""One vehicle of the simulated fleet: where it stands, whom it serves, which leg it drives."""

from __future__ import annotations

from dataclasses import dataclass, field

from slipstream.messages import PlannedSegment, VehiclePlan
from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.fleet.actuation import Driver
from slipstream_lab.simulation.fleet.brakes import RealVehicle
from slipstream_lab.simulation.fleet.driven_leg import LegMeasurement
from slipstream_lab.simulation.scenarios.demand import Deliveries


@dataclass
class SimulatedVan:
    """One vehicle of the fleet. `since_ns`: since when it stands; advice from before is for the
    road. `real`: None: it is ideal.
    """

    segment: str
    real: RealVehicle | None = None
    look_ns: int = 0
    since_ns: int = 0
    tour: int = -1
    begun: int | None = None
    leg: int = 0
    ready_s: float = 0.0
    serves: tuple[str, float] | None = None
    told_s: float = 0.0
    way: DrivenWay | None = None
    entering: bool = False
    measured: LegMeasurement | None = None
    driver: Driver = field(default_factory=lambda: Driver(""))


@dataclass
class DrivenWay:
    """A leg that is driven. `behind`: segments of the path that lay behind when SUMO was given its
    present route.
    """

    plan: VehiclePlan
    number: int
    planned: tuple[PlannedSegment, ...]
    path: tuple[str, ...]
    due_s: float
    free_s: float
    first: int = 0
    driven: tuple[str, ...] = ()
    behind: int = 0
    at: int = 0


def yard(network: RoadNetwork, node: str) -> str:
    """A segment that ends at a depot's junction, for a vehicle that stands in its yard."""
    return min(segment.id for segment in network.segments.values() if segment.end == node)


def yards(deliveries: Deliveries, network: RoadNetwork) -> dict[str, str]:
    """Where each vehicle of a fleet stands when its day begins; see `yard`."""
    nodes = {depot.id: depot.node for depot in deliveries.settings.depots}
    return {van: yard(network, nodes[depot]) for van, depot in deliveries.vehicles.items()}


def planned_leg(plan: VehiclePlan, leg: int) -> tuple[PlannedSegment, ...]:
    """The segments of one leg of a plan."""
    return tuple(segment for segment in plan.segments if segment.leg == leg)

"""A vehicle of the running simulation as its agent sees it: its leg, and where it is."""

from __future__ import annotations

import libsumo

from slipstream.messages import PlannedCrossing, PlannedSegment
from slipstream.roads import RoadNetwork
from vehicle_agent.leg import Leg, VehicleState


def leg_of(network: RoadNetwork, path: tuple[str, ...]) -> Leg:
    """A leg as the dispatcher would send it."""
    planned = []
    for i, name in enumerate(path):
        segment = network.segments[name]
        known = network.crossings[name, path[i + 1]] if i + 1 < len(path) else None
        crossing = known and PlannedCrossing(
            length_m=known.length_m,
            speed_mps=known.speed_mps,
            yields=known.yields,
            intersection=known.intersection,
            signal_groups=tuple(sorted(known.signal_groups.items())),
        )
        planned.append(
            PlannedSegment(
                segment=name,
                entry_ns=0,
                exit_ns=0,
                speed_mps=segment.speed_limit_mps,
                platoon=None,
                place=None,
                gap_m=None,
                leg=0,
                length_m=segment.length_m,
                speed_limit_mps=segment.speed_limit_mps,
                lanes=segment.lanes,
                crossing=crossing,
            )
        )
    return Leg(1, 0, tuple(planned))


def state_of(name: str, leg: Leg) -> VehicleState:
    """Where a vehicle is; it must be on the road, on the route that is its leg."""
    vehicle = libsumo.vehicle
    number = max(0, vehicle.getRouteIndex(name))
    return VehicleState(
        leg.path[number],
        number,
        vehicle.getRoadID(name).startswith(":"),
        vehicle.getLaneIndex(name),
        vehicle.getLanePosition(name),
        vehicle.getSpeed(name),
    )

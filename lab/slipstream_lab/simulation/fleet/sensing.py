"""What a vehicle of the running simulation senses, as a message to its agent."""

from __future__ import annotations

from typing import Final

import libsumo

from slipstream.messages import SensedVehicle, VehicleSensing
from slipstream_lab.simulation.sumo import FLEET_PREFIX

PREFIX: Final = FLEET_PREFIX

_RANGE_M: Final = 120.0


def fleet_vehicle(name: str) -> str | None:
    """The fleet's vehicle of a SUMO id; None: one of the background."""
    return name[len(PREFIX) :].rsplit("/", 2)[0] if name.startswith(PREFIX) else None


def sense(name: str, segment: str, time_ns: int, acceleration_mps2: float) -> VehicleSensing:
    """The sensing of a vehicle on the road."""
    vehicle = libsumo.vehicle
    return VehicleSensing(
        vehicle=fleet_vehicle(name) or name,
        time_ns=time_ns,
        on_road=True,
        segment=segment,
        crossing=vehicle.getRoadID(name).startswith(":"),
        lane=vehicle.getLaneIndex(name),
        front_m=max(0.0, vehicle.getLanePosition(name)),
        speed_mps=max(0.0, vehicle.getSpeed(name)),
        acceleration_mps2=acceleration_mps2,
        driven_m=max(0.0, vehicle.getDistance(name)),
        ahead=_ahead(name),
        behind=_behind(name),
    )


def acceleration_ahead(sensed: VehicleSensing) -> float:
    """Of the vehicle that is sensed ahead; 0 without one."""
    ahead = sensed.ahead
    return 0.0 if ahead is None else float(libsumo.vehicle.getAcceleration(ahead.track))


def standing(vehicle: str, segment: str, time_ns: int) -> VehicleSensing:
    """The sensing of a vehicle that stands beside the road, at one end of a segment."""
    return VehicleSensing(
        vehicle=vehicle,
        time_ns=time_ns,
        on_road=False,
        segment=segment,
        crossing=False,
        lane=0,
        front_m=0.0,
        speed_mps=0.0,
        acceleration_mps2=0.0,
        driven_m=0.0,
        ahead=None,
        behind=None,
    )


def _ahead(name: str) -> SensedVehicle | None:
    """The next vehicle on the lanes ahead. SUMO's gap leaves the own standing gap out."""
    vehicle = libsumo.vehicle
    found = vehicle.getLeader(name, _RANGE_M)
    if not found or not found[0] or found[1] > _RANGE_M:
        return None
    return _sensed(found[0], found[1] + vehicle.getMinGap(name))


def _behind(name: str) -> SensedVehicle | None:
    """The next vehicle behind on the same lane."""
    vehicle = libsumo.vehicle
    found = vehicle.getFollower(name, _RANGE_M)
    if not found or not found[0] or found[1] > _RANGE_M:
        return None
    return _sensed(found[0], found[1] + vehicle.getMinGap(found[0]))


def _sensed(other: str, gap_m: float) -> SensedVehicle:
    speed_mps = max(0.0, libsumo.vehicle.getSpeed(other))
    return SensedVehicle(
        track=other, vehicle=fleet_vehicle(other), gap_m=gap_m, speed_mps=speed_mps
    )

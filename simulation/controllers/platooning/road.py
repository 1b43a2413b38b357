"""Platooning's access to the running simulation: all it reads and sets in SUMO."""

from __future__ import annotations

from typing import Final

import libsumo

from simulation.controllers.vehicle import SPEED_CHECKS
from simulation.sumo import TYPES

FOLLOWER: Final = "cav-platoon"
ALONE: Final = "cav"

_LOOK_AHEAD_M: Final = 120.0
# Lanes are changed for the route and for others, not for speed nor to keep right.
_BEHIND_LEADER: Final = 0b011000000101
_AS_DRIVERS_DO: Final = 0b011001010101


def add_follower_type() -> None:
    """Add the vehicle type of followers: as of vehicles alone, without a time gap.

    Its car-following model only prevents collisions with a braking vehicle ahead.
    """
    kinds = libsumo.vehicletype
    if FOLLOWER in kinds.getIDList():
        return
    alone = TYPES[ALONE]
    kinds.copy("DEFAULT_VEHTYPE", FOLLOWER)
    kinds.setVehicleClass(FOLLOWER, alone.vclass)
    kinds.setLength(FOLLOWER, alone.length_m)
    kinds.setMaxSpeed(FOLLOWER, alone.max_speed_mps)
    kinds.setAccel(FOLLOWER, alone.acceleration_mps2)
    kinds.setDecel(FOLLOWER, alone.deceleration_mps2)
    kinds.setApparentDecel(FOLLOWER, alone.deceleration_mps2)
    kinds.setEmergencyDecel(FOLLOWER, 9.0)
    kinds.setMinGap(FOLLOWER, 0.5)
    kinds.setTau(FOLLOWER, 0.02)
    kinds.setImperfection(FOLLOWER, 0.0)
    kinds.setSpeedFactor(FOLLOWER, 1.0)
    kinds.setSpeedDeviation(FOLLOWER, 0.0)


def ahead(name: str) -> tuple[str, float] | None:
    """The next vehicle on the lanes ahead, and the gap to its rear, m."""
    found = libsumo.vehicle.getLeader(name, _LOOK_AHEAD_M)
    if not found or not found[0] or found[1] > _LOOK_AHEAD_M:
        return None
    return found[0], found[1] + libsumo.vehicle.getMinGap(name)


def behind(name: str, within_m: float) -> str | None:
    """The next vehicle behind on the same lane, within a distance, m."""
    found = libsumo.vehicle.getFollower(name, within_m)
    return found[0] if found and found[0] and found[1] <= within_m else None


def speed_mps(name: str) -> float:
    """Speed of any vehicle."""
    return float(libsumo.vehicle.getSpeed(name))


def acceleration_mps2(name: str) -> float:
    """In the last step."""
    return float(libsumo.vehicle.getAcceleration(name))


def desired_mps(name: str) -> float:
    """Speed on an empty road here: the limit times its speed factor."""
    return float(libsumo.vehicle.getAllowedSpeed(name))


def speed_factor(name: str) -> float:
    """Its own."""
    return float(libsumo.vehicle.getSpeedFactor(name))


def set_speed_factor(name: str, factor: float) -> None:
    """Desired speed over the limit."""
    libsumo.vehicle.setSpeedFactor(name, factor)


def start_control(name: str, factor: float) -> None:
    """Command its speed from now on.

    Args:
        factor: its speed factor, which SUMO resets with the type.
    """
    vehicle = libsumo.vehicle
    vehicle.setType(name, FOLLOWER)
    vehicle.setSpeedFactor(name, factor)
    vehicle.setSpeedMode(name, SPEED_CHECKS)
    vehicle.setLaneChangeMode(name, _BEHIND_LEADER)


def end_control(name: str, factor: float) -> None:
    """Return it to the IDM.

    Args:
        factor: its speed factor.
    """
    vehicle = libsumo.vehicle
    vehicle.setType(name, ALONE)
    vehicle.setSpeedFactor(name, factor)
    vehicle.setLaneChangeMode(name, _AS_DRIVERS_DO)


def change_lane(name: str, lane: int, seconds: float) -> None:
    """Change to a lane of its segment as soon as that is safe."""
    libsumo.vehicle.changeLane(name, lane, seconds)


def lane_continues(name: str, lane: int) -> bool:
    """Whether a lane of its segment continues on the vehicle's path."""
    return bool(libsumo.vehicle.getBestLanes(name)[lane][4])


def length_m(name: str) -> float:
    """Of any vehicle."""
    return float(libsumo.vehicle.getLength(name))


def lanes(segment: str) -> int:
    """Of a segment."""
    return int(libsumo.edge.getLaneNumber(segment))


def limit_mps(segment: str) -> float:
    """Speed limit of a segment."""
    return float(libsumo.lane.getMaxSpeed(f"{segment}_0"))

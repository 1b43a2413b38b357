"""A vehicle of the running simulation obeys its agent's advice: all that is set in SUMO.

A driver who follows advice drives up to the advised speed, or at it, and SUMO's checks for safety
stay on. In a close gap the car-following model only prevents collisions, as the agent keeps the
gap; when advice ends, the driver's own model takes over and opens it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import libsumo

from slipstream.messages import VehicleAdvice, VehicleSensing
from slipstream_lab.simulation.sumo import FLEET_TYPES, TYPES

SPEED_CHECKS: Final = 0b11011
"""SUMO's speed mode: all checks except the limit on deceleration. With that limit, a vehicle whose
speed is set would brake no harder than comfortable, even for a red light or a cut-in."""

ALONE, FOLLOWER = FLEET_TYPES

_HAND_OVER_NS: Final = 3_000_000_000
"""For so long after a close gap the driver's own model does not take over while the agent commands
the speed and the own lane is free. A partner that leaves by the other lane of a fork is no longer
sensed ahead, but SUMO counts it as that until it has cleared the fork: to its gap of 3 m the IDM
would answer by standing within a step, as the speed mode has no limit on deceleration.
"""
_LANE_S: Final = 3.0
# Lanes are changed for the route and for others, not for speed nor to keep right.
_BEHIND_LEADER: Final = 0b011000000101
_AS_DRIVERS_DO: Final = 0b011001010101


def add_follower_type() -> None:
    """Add the vehicle type of followers: as of vehicles alone, without a time gap."""
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


@dataclass
class Driver:
    """The driver of one vehicle on the road."""

    name: str
    pace: float = 1.0
    close: bool = False
    _held: bool = False
    _factor: float = 1.0
    _is_follower: bool = False
    _close_ns: int = 0

    def begin(self) -> None:
        """The vehicle has come onto the road."""
        libsumo.vehicle.setSpeedMode(self.name, SPEED_CHECKS)
        self._set_factor(self.pace)

    def obey(self, advice: VehicleAdvice | None, sensed: VehicleSensing) -> None:
        """Set what the coming step is driven by."""
        mode = "none" if advice is None else advice.mode
        self.close = mode in ("follow", "open_gap")
        commanded = advice is not None and mode in ("speed", "follow", "open_gap")
        self._choose_type(sensed, commanded)
        if advice is not None and commanded:
            assert advice.speed_mps is not None
            libsumo.vehicle.setSpeed(self.name, advice.speed_mps)
            self._held = True
        elif self._held:
            libsumo.vehicle.setSpeed(self.name, -1)
            self._held = False
        self._set_factor(self.pace if self.close else self._cruise_factor(advice, sensed.segment))
        if advice is not None and advice.lane is not None:
            self._change_lane(advice.lane)

    def _cruise_factor(self, advice: VehicleAdvice | None, segment: str) -> float:
        """Desired speed over the limit: lower where a partner is to catch up.

        Not a speed command: under one SUMO does not slow down for signals as its drivers do.
        """
        if advice is None or advice.mode != "cruise" or advice.partner is None:
            return self.pace
        assert advice.speed_mps is not None
        limit_mps = float(libsumo.lane.getMaxSpeed(f"{segment}_0"))
        return min(self.pace, max(0.1, advice.speed_mps / limit_mps))

    def _change_lane(self, lane: int) -> None:
        """Change as soon as that is safe, unless the lane does not lead on."""
        vehicle = libsumo.vehicle
        if vehicle.getRoadID(self.name).startswith(":"):
            return
        lanes = vehicle.getBestLanes(self.name)
        if lane < len(lanes) and lanes[lane][4]:
            vehicle.changeLane(self.name, lane, _LANE_S)

    def _choose_type(self, sensed: VehicleSensing, commanded: bool) -> None:
        if self.close:
            self._close_ns = sensed.time_ns
            if not self._is_follower:
                self._take_control()
        elif self._is_follower:
            alone = TYPES[ALONE]
            own_gap_m = alone.min_gap_m + alone.time_gap_s * sensed.speed_mps
            is_free = sensed.ahead is None or sensed.ahead.gap_m > own_gap_m
            is_soon = sensed.time_ns < self._close_ns + _HAND_OVER_NS
            if not (commanded and is_free and is_soon):
                self._return_control()

    def _take_control(self) -> None:
        add_follower_type()
        vehicle = libsumo.vehicle
        vehicle.setType(self.name, FOLLOWER)
        vehicle.setSpeedMode(self.name, SPEED_CHECKS)
        vehicle.setLaneChangeMode(self.name, _BEHIND_LEADER)
        self._is_follower, self._factor = True, 1.0  # SUMO resets the factor with the type

    def _return_control(self) -> None:
        libsumo.vehicle.setType(self.name, ALONE)
        libsumo.vehicle.setLaneChangeMode(self.name, _AS_DRIVERS_DO)
        self._is_follower, self._factor = False, 1.0

    def _set_factor(self, factor: float) -> None:
        if factor != self._factor:
            libsumo.vehicle.setSpeedFactor(self.name, factor)
            self._factor = factor

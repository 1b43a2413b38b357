"""A vehicle of the running simulation obeys its agent's advice: all that is set in SUMO.

A driver who follows advice drives up to the advised speed, or at it, and SUMO's checks for safety
stay on. In a close gap the car-following model only prevents collisions, as the agent keeps the
gap; when advice ends, the driver's own model takes over and opens it.

A vehicle that is not ideal comes to what it is advised by its brakes (`brakes`). An advised
acceleration holds for the step, and no driver's model is active meanwhile. Where an advice of a
close gap ends without another one, it brakes as that one says until the gap is its driver's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import libsumo

from slipstream.messages import VehicleAdvice, VehicleSensing
from slipstream.vehicle_types import VehicleType
from slipstream_lab.simulation.fleet.brakes import RealVehicle
from slipstream_lab.simulation.sumo import FLEET_TYPES, TYPES

SPEED_CHECKS: Final = 0b11011
"""SUMO's speed mode: all checks except the limit on deceleration. With that limit, a vehicle whose
speed is set would brake no harder than comfortable, even for a red light or a cut-in."""

ALONE, FOLLOWER, CLOSE = FLEET_TYPES
"""FOLLOWER: of ideal vehicles in a platoon, and of leaders that are not. CLOSE: of followers that
are not ideal. Its agent and its brakes alone keep their gap: SUMO's check would have them brake as
soon as comfortable braking of both could bring them together, and call 0.4 m a collision."""

_CLOSE_MPS2: Final = 9.0
_CLOSE_GAP_M: Final = 0.1

_HAND_OVER_NS: Final = 3_000_000_000
"""For so long after a close gap the driver's own model does not take over while the agent commands
the speed and the own lane is free. A partner that leaves by the other lane of a fork is no longer
sensed ahead, but SUMO counts it as that until it has cleared the fork: to its gap of 3 m the IDM
would answer by standing within a step, as the speed mode has no limit on deceleration.
"""
_LANE_S: Final = 3.0
_AS_SET_MPS: Final = 0.02
_HELD_MPS2: Final = 0.5
"""Braked harder than by its own brakes, a vehicle is held back by SUMO's check."""
# Lanes are changed for the route and for others, not for speed nor to keep right.
_BEHIND_LEADER: Final = 0b011000000101
_AS_DRIVERS_DO: Final = 0b011001010101


def shape_fleet(kind: VehicleType, pace: float) -> None:
    """Give SUMO's type of the fleet the class, dimensions and top speed of a type of vehicles, as
    far as they are known. Slowed, a vehicle is slower than its top speed too.
    """
    kinds = libsumo.vehicletype
    kinds.setVehicleClass(ALONE, kind.vehicle_class)
    slowest = min(1.0, pace)
    top_mps = None if kind.max_speed_mps is None else slowest * kind.max_speed_mps
    for give, value in (
        (kinds.setLength, kind.length_m),
        (kinds.setWidth, kind.width_m),
        (kinds.setHeight, kind.height_m),
        (kinds.setMaxSpeed, top_mps),
    ):
        if value is not None:
            give(ALONE, value)


def add_follower_type(
    name: str = FOLLOWER,
    deceleration_mps2: float = TYPES[ALONE].deceleration_mps2,
    min_gap_m: float = 0.5,
) -> None:
    """Add the vehicle type of followers: as of vehicles alone, without a time gap."""
    kinds = libsumo.vehicletype
    if name in kinds.getIDList():
        return
    alone = TYPES[ALONE]
    kinds.copy("DEFAULT_VEHTYPE", name)
    kinds.setVehicleClass(name, kinds.getVehicleClass(ALONE))
    kinds.setLength(name, kinds.getLength(ALONE))
    kinds.setWidth(name, kinds.getWidth(ALONE))
    kinds.setHeight(name, kinds.getHeight(ALONE))
    kinds.setMaxSpeed(name, kinds.getMaxSpeed(ALONE))
    kinds.setAccel(name, alone.acceleration_mps2)
    kinds.setDecel(name, deceleration_mps2)
    kinds.setApparentDecel(name, alone.deceleration_mps2)
    kinds.setEmergencyDecel(name, 9.0)
    kinds.setMinGap(name, min_gap_m)
    kinds.setTau(name, 0.02)
    kinds.setImperfection(name, 0.0)
    kinds.setSpeedFactor(name, 1.0)
    kinds.setSpeedDeviation(name, 0.0)


@dataclass
class Driver:
    """The driver of one vehicle on the road.

    Attributes:
        real: its brakes and sensors; None: it is ideal.
        close: whether it is advised in a close gap.
        held: steps in which SUMO's own check braked it harder than it was commanded.
    """

    name: str
    pace: float = 1.0
    step_s: float = 0.5
    real: RealVehicle | None = None
    close: bool = False
    held: int = 0
    _set_mps: float | None = None
    _before_mps: float | None = None
    _fallback_mps2: float | None = None
    _held: bool = False
    _factor: float = 1.0
    _kind: str | None = None
    _close_ns: int = 0
    _lane_mode: int = 0

    def begin(self) -> None:
        """The vehicle has come onto the road."""
        libsumo.vehicle.setSpeedMode(self.name, SPEED_CHECKS)
        self._set_factor(self.pace)

    def obey(self, advice: VehicleAdvice | None, sensed: VehicleSensing) -> None:
        """Set what the coming step is driven by."""
        mode = "none" if advice is None else advice.mode
        self.close = mode in ("follow", "open_gap")
        commanded = advice is not None and mode in ("speed", "follow", "open_gap")
        wanted_mps2 = None
        if self.real is not None:
            self._came_to(sensed.speed_mps)
            wanted_mps2 = self._wanted_mps2(advice, sensed, self.real)
        leads = mode == "speed"
        kind = None
        if self.close or (advice is None and wanted_mps2 is not None):
            kind = FOLLOWER if self.real is None else CLOSE
        elif wanted_mps2 is not None and advice is not None:
            # A set speed alone leaves the driver's model in charge.
            kind = None if advice.acceleration_mps2 is None else FOLLOWER
        self._choose_type(sensed, commanded, kind, _AS_DRIVERS_DO if leads else _BEHIND_LEADER)
        if self.real is not None and wanted_mps2 is not None:
            self._set_mps = self.real.brakes.drive(sensed.speed_mps, wanted_mps2, self.step_s)
            libsumo.vehicle.setSpeed(self.name, self._set_mps)
            self._held = True
        elif advice is not None and commanded:
            assert advice.speed_mps is not None
            libsumo.vehicle.setSpeed(self.name, advice.speed_mps)
            self._held = True
        elif self._held:
            libsumo.vehicle.setSpeed(self.name, -1)
            self._held = False
        self._set_factor(self.pace if self.close else self._cruise_factor(advice, sensed.segment))
        if advice is not None and advice.lane is not None:
            self._change_lane(advice.lane)

    def _came_to(self, speed_mps: float) -> None:
        """Where it was driven by other than its commands, its brakes go on from there."""
        assert self.real is not None
        before_mps, set_mps = self._before_mps, self._set_mps
        if before_mps is not None and (set_mps is None or abs(speed_mps - set_mps) > _AS_SET_MPS):
            self.real.brakes.took((speed_mps - before_mps) / self.step_s)
            if set_mps is not None and set_mps - speed_mps > _HELD_MPS2 * self.step_s:
                self.held += self._kind is not None
        self._before_mps, self._set_mps = speed_mps, None

    def _wanted_mps2(
        self, advice: VehicleAdvice | None, sensed: VehicleSensing, real: RealVehicle
    ) -> float | None:
        """The acceleration that its brakes and drive are commanded; None: its driver drives."""
        if advice is None:
            if self._fallback_mps2 is None or self._is_free(sensed):
                self._fallback_mps2 = None
                return None
            return -self._fallback_mps2
        self._fallback_mps2 = advice.fallback_mps2
        if advice.mode in ("none", "cruise"):
            return None
        if advice.acceleration_mps2 is not None:
            return advice.acceleration_mps2
        assert advice.speed_mps is not None
        response_s = max(2 * real.braking.nominal_s, self.step_s)
        then_mps = sensed.speed_mps + real.brakes.acceleration_mps2 * real.brakes.lag_s
        return (advice.speed_mps - then_mps) / response_s

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

    @staticmethod
    def _is_free(sensed: VehicleSensing) -> bool:
        """Whether it has the gap of a driver."""
        alone = TYPES[ALONE]
        own_gap_m = alone.min_gap_m + alone.time_gap_s * sensed.speed_mps
        return sensed.ahead is None or sensed.ahead.gap_m > own_gap_m

    def _choose_type(
        self, sensed: VehicleSensing, commanded: bool, kind: str | None, lane_mode: int
    ) -> None:
        if kind is not None:
            self._close_ns = sensed.time_ns
            if kind != self._kind:
                self._take_control(kind)
            if lane_mode != self._lane_mode:
                libsumo.vehicle.setLaneChangeMode(self.name, lane_mode)
                self._lane_mode = lane_mode
        elif self._kind is not None:
            is_soon = sensed.time_ns < self._close_ns + _HAND_OVER_NS
            if not (commanded and self._is_free(sensed) and is_soon):
                self._return_control()

    def _take_control(self, kind: str) -> None:
        if kind == CLOSE:
            add_follower_type(CLOSE, _CLOSE_MPS2, _CLOSE_GAP_M)
        else:
            add_follower_type()
        vehicle = libsumo.vehicle
        vehicle.setType(self.name, kind)
        vehicle.setSpeedMode(self.name, SPEED_CHECKS)
        self._kind, self._factor = kind, 1.0  # SUMO resets the factor with the type

    def _return_control(self) -> None:
        libsumo.vehicle.setType(self.name, ALONE)
        libsumo.vehicle.setLaneChangeMode(self.name, _AS_DRIVERS_DO)
        self._kind, self._factor, self._lane_mode = None, 1.0, 0

    def _set_factor(self, factor: float) -> None:
        if factor != self._factor:
            libsumo.vehicle.setSpeedFactor(self.name, factor)
            self._factor = factor

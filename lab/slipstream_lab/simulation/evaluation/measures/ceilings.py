"""What the deliveries of an arm would have cost at best: every kilometre drafted, no stop, both.

Ceilings keep an arm's legs, so they say what driving can save, not what routes can. Each is a bound
by the physics of `slipstream.energy.consumption` alone; no lever reaches it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from slipstream.energy.consumption import (
    VehicleParameters,
    drive_energies,
    steady_energy_kwh,
)
from slipstream.energy.drafting import greatest_reduction
from slipstream.energy.drive import Drive, DrivingStyle, plan_drive
from slipstream.roads import RoadNetwork
from slipstream.vehicle_types import VehicleType
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg
from slipstream_lab.simulation.sumo import TYPES

_CAV: Final = TYPES["cav"]
_STYLE: Final = DrivingStyle(_CAV.acceleration_mps2, _CAV.deceleration_mps2)
_SLOWEST: Final = 0.3
"""Of the limits: the empty road is driven no slower to fill a time."""


@dataclass(frozen=True)
class Ideal:
    """An ideal drive of an arm's legs."""

    alone_kwh: float
    drafted_kwh: float
    travel_s: float


@dataclass(frozen=True)
class Ceilings:
    """An arm's legs as they were driven, and at best.

    Attributes:
        driven: speeds as they were. Drafted, it is a bound: at those speeds a follower needs this
            or more, since it brakes a little more often.
        free: empty roads and no red, at the limit; turns, lower limits and deliveries are kept.
        free_in_time: the same, so much slower that the arm's legs take as long as they took.
        steady: no braking at all, not even to deliver: each leg at its mean speed, the least that
            its distance can cost in its time.
    """

    driven: Ideal
    free: Ideal
    free_in_time: Ideal
    steady: Ideal

    def savings(self) -> dict[str, float]:
        """Most that can be saved, by what is taken away, as a share of the energy alone."""
        base = self.driven.alone_kwh
        found = {
            "drafting": self.driven.drafted_kwh,
            "no signals or traffic": self.free.alone_kwh,
            "no signals or traffic, drafting": self.free.drafted_kwh,
            "the same in the same time": self.free_in_time.alone_kwh,
            "the same in the same time, drafting": self.free_in_time.drafted_kwh,
            "no braking": self.steady.alone_kwh,
            "no braking, drafting": self.steady.drafted_kwh,
        }
        return {name: 1 - kwh / base for name, kwh in found.items()}


def compute_ceilings(arm: ArmResult, roads: RoadNetwork, kind: VehicleType) -> Ceilings:
    """Ceilings of an arm whose vehicles are of a type. Raises ValueError: the arm drove nothing."""
    legs, vehicle, eta = arm.legs, kind.profile.physics, greatest_reduction(kind.drafting)
    if not legs:
        raise ValueError("an arm without legs has no ceilings")
    travel_s = sum(leg.arrived_s - leg.departed_s for leg in legs)
    alone_kwh = sum(leg.alone.total_kwh for leg in legs)
    drag_kwh = sum(leg.alone.drag_kwh for leg in legs)
    return Ceilings(
        Ideal(alone_kwh, alone_kwh - eta * drag_kwh, travel_s),
        _free(legs, roads, 1.0, kind),
        _free(legs, roads, _pace(legs, roads, travel_s, kind), kind),
        Ideal(_steady_kwh(legs, 0.0, vehicle), _steady_kwh(legs, eta, vehicle), travel_s),
    )


def share_of_ceiling(saving: float, ceiling: float) -> float | None:
    """How much of what can be had a saving is; None where nothing can be had."""
    return saving / ceiling if ceiling > 0 else None


def free_drive(
    path: Sequence[str], roads: RoadNetwork, kind: VehicleType, pace: float = 1.0
) -> Drive:
    """A leg on empty roads without signals: limits, the vehicle's top speed, and the speeds that
    turns allow. Raises KeyError: a segment that the net has not, or two that no lane joins.
    """
    lengths, speeds, top_mps = [], [], kind.max_speed_mps or math.inf
    for number, segment in enumerate(path):
        if number > 0:
            way = roads.crossings[path[number - 1], segment]
            if way.length_m > 0:
                lengths.append(way.length_m)
                speeds.append(pace * min(way.speed_mps, top_mps))
        lengths.append(roads.segments[segment].length_m)
        speeds.append(pace * min(roads.segments[segment].speed_limit_mps, top_mps))
    return plan_drive(lengths, speeds, _STYLE)


def _free(legs: Sequence[DrivenLeg], roads: RoadNetwork, pace: float, kind: VehicleType) -> Ideal:
    vehicle = kind.profile.physics
    drives = [free_drive(leg.path, roads, kind, pace) for leg in legs]
    alone, drafted = (
        drive_energies(drives, [[eta] * len(d.entry_s) for d in drives], vehicle).sum().total_kwh
        for eta in (0.0, greatest_reduction(kind.drafting))
    )
    return Ideal(alone, drafted, sum(drive.duration_s for drive in drives))


def _pace(
    legs: Sequence[DrivenLeg], roads: RoadNetwork, travel_s: float, kind: VehicleType
) -> float:
    """The pace at which all legs together take a time on empty roads, at most 1."""
    low, high = _SLOWEST, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        taken_s = sum(free_drive(leg.path, roads, kind, middle).duration_s for leg in legs)
        low, high = (middle, high) if taken_s > travel_s else (low, middle)
    return high


def _steady_kwh(legs: Sequence[DrivenLeg], eta: float, vehicle: VehicleParameters) -> float:
    return sum(
        steady_energy_kwh(
            leg.distance_m, leg.distance_m / (leg.arrived_s - leg.departed_s), eta, vehicle=vehicle
        )
        for leg in legs
    )

"""What the deliveries of an arm would have cost at best: every kilometre drafted, no stop, both.

Ceilings keep an arm's legs, so they say what driving can save, not what routes can. Each is a bound
by the physics of `slipstream.energy.consumption` alone; no lever reaches it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from slipstream.energy.consumption import (
    ETA_FOLLOWER,
    PAPER_CAR,
    VehicleParameters,
    drive_energies,
    steady_energy_kwh,
)
from slipstream.energy.drive import Drive, DrivingStyle, plan_drive
from slipstream.roads import RoadNetwork
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


def compute_ceilings(
    arm: ArmResult, roads: RoadNetwork, vehicle: VehicleParameters = PAPER_CAR
) -> Ceilings:
    """Ceilings of an arm. Raises ValueError: the arm drove nothing."""
    legs = arm.legs
    if not legs:
        raise ValueError("an arm without legs has no ceilings")
    travel_s = sum(leg.arrived_s - leg.departed_s for leg in legs)
    alone_kwh = sum(leg.alone.total_kwh for leg in legs)
    drag_kwh = sum(leg.alone.drag_kwh for leg in legs)
    return Ceilings(
        Ideal(alone_kwh, alone_kwh - ETA_FOLLOWER * drag_kwh, travel_s),
        _free(legs, roads, 1.0, vehicle),
        _free(legs, roads, _pace(legs, roads, travel_s), vehicle),
        Ideal(_steady_kwh(legs, 0.0, vehicle), _steady_kwh(legs, ETA_FOLLOWER, vehicle), travel_s),
    )


def share_of_ceiling(saving: float, ceiling: float) -> float | None:
    """How much of what can be had a saving is; None where nothing can be had."""
    return saving / ceiling if ceiling > 0 else None


def free_drive(path: Sequence[str], roads: RoadNetwork, pace: float = 1.0) -> Drive:
    """A leg on empty roads without signals: limits, and the speeds that turns allow. Raises
    KeyError: a segment that the net has not, or two that no lane joins.
    """
    lengths, speeds = [], []
    for number, segment in enumerate(path):
        if number > 0:
            way = roads.crossings[path[number - 1], segment]
            if way.length_m > 0:
                lengths.append(way.length_m)
                speeds.append(pace * way.speed_mps)
        lengths.append(roads.segments[segment].length_m)
        speeds.append(pace * roads.segments[segment].speed_limit_mps)
    return plan_drive(lengths, speeds, _STYLE)


def _free(
    legs: Sequence[DrivenLeg], roads: RoadNetwork, pace: float, vehicle: VehicleParameters
) -> Ideal:
    drives = [free_drive(leg.path, roads, pace) for leg in legs]
    alone, drafted = (
        drive_energies(drives, [[eta] * len(d.entry_s) for d in drives], vehicle).sum().total_kwh
        for eta in (0.0, ETA_FOLLOWER)
    )
    return Ideal(alone, drafted, sum(drive.duration_s for drive in drives))


def _pace(legs: Sequence[DrivenLeg], roads: RoadNetwork, travel_s: float) -> float:
    """The pace at which all legs together take a time on empty roads, at most 1."""
    low, high = _SLOWEST, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        taken_s = sum(free_drive(leg.path, roads, middle).duration_s for leg in legs)
        low, high = (middle, high) if taken_s > travel_s else (low, middle)
    return high


def _steady_kwh(legs: Sequence[DrivenLeg], eta: float, vehicle: VehicleParameters) -> float:
    return sum(
        steady_energy_kwh(
            leg.distance_m, leg.distance_m / (leg.arrived_s - leg.departed_s), eta, vehicle=vehicle
        )
        for leg in legs
    )

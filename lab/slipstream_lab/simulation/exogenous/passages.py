"""Legs driven on recorded traffic: platoons, and the energy of each leg."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dispatcher_daemon.planning.platooning import TimedPassage, platoons_of
from dispatcher_daemon.planning.roads import held_cost_kwh
from dispatcher_daemon.traffic import SegmentTraffic
from slipstream.energy.consumption import (
    ETA_ALONE,
    ETA_FOLLOWER,
    ETA_LEADER,
    Energies,
    Energy,
    drive_energies,
    steady_energy_kwh,
)
from slipstream.energy.drive import Drive
from slipstream.roads import RoadNetwork
from slipstream.vehicle_types import RoutingProfile
from slipstream_lab.simulation.closed_loop.gates import is_turbulent
from slipstream_lab.simulation.exogenous.roadside import RecordedRoadside
from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg
from slipstream_lab.simulation.fleet.losses import drive_losses

Passage = tuple[str, int, int]
"""One vehicle on one segment: (vehicle, number of the leg, position in its path)."""


@dataclass(frozen=True)
class RecordedLeg:
    """A leg on recorded traffic, from rest to rest; times in s since midnight.

    Attributes:
        round: number of the tour in the vehicle's day, from 0.
        due_s: its departure; times of the drive count from it.
    """

    vehicle: str
    round: int
    leg: int
    path: tuple[str, ...]
    ready_s: float
    due_s: float
    drive: Drive
    free_s: float

    @property
    def arrived_s(self) -> float:
        """When it ends."""
        return self.due_s + self.drive.duration_s


def evaluate(
    legs: Sequence[RecordedLeg],
    roadside: RecordedRoadside,
    network: RoadNetwork,
    sync_window_s: float,
    longest: int,
) -> tuple[tuple[DrivenLeg, ...], int]:
    """The legs with platoons from exact times and energies, and the number of platoons on segments
    that were turbulent in truth.

    On a segment whose gate is open when they enter it, vehicles within the window drive as a
    platoon (`planning.platooning`). On one that is turbulent in truth, the traffic's accelerations
    come on top of the drive's own (`turbulence_kwh`).

    Args:
        longest: number of vehicles that a platoon has at most.
    """
    entries = _entries(legs)
    eta = [[ETA_ALONE] * len(leg.path) for leg in legs]
    platooned_s = [0.0] * len(legs)
    disengagements = 0
    extra = np.zeros(len(legs))
    for segment in sorted(entries):
        passing = entries[segment]
        for entry, leaving, (_, index, _) in passing:
            extra[index] += turbulence_kwh(roadside, network, segment, entry, leaving)
        welcome = [timed for timed in passing if roadside.is_open(segment, timed[0])]
        for group in platoons_of(welcome, sync_window_s, longest):
            if len(group) < 2:
                continue
            truth = roadside.truth(segment, group[0][0])
            turbulent = is_turbulent(truth)
            disengagements += turbulent
            for place, (entry, leaving, (_, index, position)) in enumerate(group):
                eta[index][position] = ETA_FOLLOWER if place else ETA_LEADER
                platooned_s[index] += turbulent * (leaving - entry)
    drives = [leg.drive for leg in legs]
    alone = _with(drive_energies(drives, [[ETA_ALONE] * len(e) for e in eta]), extra)
    driven = _with(drive_energies(drives, eta), extra)
    made = [
        _driven_leg(leg, eta[i], network, driven[i], alone[i], platooned_s[i], float(extra[i]))
        for i, leg in enumerate(legs)
    ]
    made.sort(key=lambda leg: (leg.arrived_s, leg.vehicle))
    return tuple(made), disengagements


def turbulence_kwh(
    roadside: RecordedRoadside, network: RoadNetwork, segment: str, entry_s: float, exit_s: float
) -> float:
    """What a turbulent segment costs beyond steady driving, kWh, ≥ 0; 0 where it is calm or nobody
    knows.

    The expected positive tractive force under the traffic's σ²_a, as the dispatcher's costs have
    it. The traffic's mean acceleration is left out: changes of speed from segment to segment are
    in the drive already.
    """
    truth = roadside.truth(segment, entry_s)
    if truth is None or not is_turbulent(truth) or exit_s <= entry_s:
        return 0.0
    road = network.segments[segment]
    speed = road.length_m / (exit_s - entry_s)
    traffic = SegmentTraffic(
        segment,
        speed,
        y_e=0,
        measured_speed_mps=speed,
        acceleration_variance_m2ps4=truth.acceleration_variance_m2ps4,
    )
    held_kwh = held_cost_kwh(road, traffic, RoutingProfile())
    return held_kwh - steady_energy_kwh(road.length_m, speed)


def _entries(legs: Sequence[RecordedLeg]) -> dict[str, list[TimedPassage[Passage]]]:
    """Passages of each segment in the order of entry."""
    entries: dict[str, list[TimedPassage[Passage]]] = {}
    for index, leg in enumerate(legs):
        times = (leg.due_s + s for s in (*leg.drive.entry_s, leg.drive.duration_s))
        for position, (segment, (entry, leaving)) in enumerate(
            zip(leg.path, pairwise(times), strict=True)
        ):
            passage = (leg.vehicle, index, position)
            entries.setdefault(segment, []).append((entry, leaving, passage))
    for passing in entries.values():
        passing.sort()
    return entries


def _with(
    energies: Energies, extra_kwh: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> list[Energy]:
    """One energy a leg, with more for acceleration."""
    total, rolling, drag, acceleration = energies
    rows = zip(total + extra_kwh, rolling, drag, acceleration + extra_kwh, strict=True)
    return [Energy(*map(float, row)) for row in rows]


def _driven_leg(
    leg: RecordedLeg,
    eta: Sequence[float],
    network: RoadNetwork,
    driven: Energy,
    alone: Energy,
    turbulent_s: float,
    extra_kwh: float,
) -> DrivenLeg:
    def length_m(wanted: float) -> float:
        return sum(
            network.segments[segment].length_m
            for segment, own in zip(leg.path, eta, strict=True)
            if own == wanted
        )

    own = drive_losses(leg.drive)
    return DrivenLeg(
        vehicle=leg.vehicle,
        round=leg.round,
        leg=leg.leg,
        ready_s=leg.ready_s,
        due_s=leg.due_s,
        departed_s=leg.due_s,
        arrived_s=leg.arrived_s,
        free_s=leg.free_s,
        distance_m=leg.drive.length_m,
        driven=driven,
        alone=alone,
        led_m=length_m(ETA_LEADER),
        followed_m=length_m(ETA_FOLLOWER),
        stops=0,
        waited_s=0.0,
        turbulent_s=turbulent_s,
        path=leg.path,
        losses=own._replace(slowing_kwh=own.slowing_kwh + extra_kwh),
    )

"""A leg that a vehicle has driven, and its measurement while it lasts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from slipstream.energy.consumption import ETA_ALONE, Energy, VehicleParameters, trace_energy
from slipstream.energy.drive import DrivingStyle, plan_drive
from slipstream.messages import PlannedSegment
from slipstream_lab.simulation.fleet.drafting import Cause
from slipstream_lab.simulation.fleet.losses import Losses, losses

_STANDING_MPS: Final = 0.1
_ROLLING_MPS: Final = 1.0


@dataclass(frozen=True)
class DrivenLeg:
    """One driven leg of a tour, from rest at one place to rest at the next.

    Attributes:
        round: number of the tour in the vehicle's day, from 0.
        ready_s: when it could have left: its plan was made, or the delivery before it was done; s
            since midnight.
        free_s: what the leg takes at the limit on an empty road, as the dispatcher plans it.
        turbulent_s: time in a close gap, leaving included, on a segment whose true traffic was
            turbulent.
    """

    vehicle: str
    round: int
    leg: int
    ready_s: float
    due_s: float
    departed_s: float
    arrived_s: float
    free_s: float
    distance_m: float
    driven: Energy
    alone: Energy
    led_m: float
    followed_m: float
    stops: int
    waited_s: float
    turbulent_s: float
    path: tuple[str, ...]
    losses: Losses
    missed_m: Mapping[Cause, float] = field(default_factory=dict)

    @property
    def travel_s(self) -> float:
        """From when it could have left to the arrival: waiting for others to meet counts, and
        waiting to get onto the road.
        """
        return self.arrived_s - self.ready_s


@dataclass
class LegMeasurement:
    """What is measured of a leg, step by step; fields as of `DrivenLeg`."""

    departed_s: float
    speeds_mps: list[float] = field(default_factory=lambda: [0.0])
    eta: list[float] = field(default_factory=list)
    driven_m: float = 0.0
    led_m: float = 0.0
    followed_m: float = 0.0
    stops: int = 0
    waited_s: float = 0.0
    turbulent_s: float = 0.0
    missed_m: dict[Cause, float] = field(default_factory=dict)
    _moved: bool = False

    def take(
        self,
        speed_mps: float,
        driven_m: float,
        eta: float,
        step_s: float,
        *,
        place: int | None,
        turbulent: bool,
        missed: Cause | None = None,
    ) -> None:
        """Add a step.

        Args:
            place: in a platoon, 0 is the leader; None: alone.
            missed: why it was not in the platoon that its plan has; None: it was, or there is none.
        """
        way_m = driven_m - self.driven_m
        if place == 0:
            self.led_m += way_m
        elif place is not None:
            self.followed_m += way_m
        if missed is not None:
            self.missed_m[missed] = self.missed_m.get(missed, 0.0) + way_m
        self.turbulent_s += step_s if turbulent else 0.0
        self.speeds_mps.append(speed_mps)
        self.eta.append(eta)
        self.driven_m = driven_m
        if speed_mps < _STANDING_MPS:
            self.waited_s += step_s
            self.stops += self._moved
            self._moved = False
        elif speed_mps > _ROLLING_MPS:
            self._moved = True

    def finish(
        self,
        vehicle: str,
        tour: int,
        leg: int,
        times_s: tuple[float, float, float],
        free_s: float,
        path: tuple[str, ...],
        step_s: float,
        physics: VehicleParameters,
    ) -> DrivenLeg:
        """The leg, which has ended."""
        # It comes to rest in the step in which it is taken off.
        speeds, eta = [*self.speeds_mps, 0.0], [*self.eta, ETA_ALONE]
        ready_s, due_s, arrived_s = times_s
        return DrivenLeg(
            vehicle=vehicle,
            round=tour,
            leg=leg,
            ready_s=ready_s,
            due_s=due_s,
            departed_s=self.departed_s,
            arrived_s=arrived_s,
            free_s=free_s,
            distance_m=self.driven_m,
            driven=trace_energy(speeds, step_s, eta, physics),
            alone=trace_energy(speeds, step_s, ETA_ALONE, physics),
            led_m=self.led_m,
            followed_m=self.followed_m,
            stops=self.stops,
            waited_s=self.waited_s,
            turbulent_s=self.turbulent_s,
            path=path,
            losses=losses(speeds, step_s, physics),
            missed_m=self.missed_m,
        )


def free_s(planned: tuple[PlannedSegment, ...], top_mps: float) -> float:
    """Time of a leg from rest to rest at the limit, or the top speed, on empty roads, s."""
    lengths_m = [segment.length_m or 0.0 for segment in planned]
    limits_mps = [min(one.speed_limit_mps or one.speed_mps, top_mps) for one in planned]
    return plan_drive(lengths_m, limits_mps, DrivingStyle()).duration_s

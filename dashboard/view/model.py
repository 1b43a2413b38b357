"""The view model: all that the page shows at one moment, as plain data."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

from dashboard.view.labels import VEHICLE_RGB, Level, Rgb, Traffic
from dashboard.view.progress import Progress
from slipstream.messages import RsuHealth, VehiclePlan

LIST_FOR_S: Final = 24 * 3600.0
"""Vehicles are listed this long after their plan expired, RSUs this long after their health, s."""


@dataclass(frozen=True)
class RoadView:
    """One watched road segment: the traffic on it now, and its gate in the last cycle.

    ``speed_kmh`` and ``cv`` (standard deviation of speed over its mean) are None where traffic is
    unknown.
    """

    segment: str
    rsu: str
    traffic: Traffic
    reason: str
    speed_kmh: float | None
    cv: float | None
    gate_cycle: int | None
    gate_open: bool
    gate_reason: str
    reason_code: str | None = None
    vehicles: int | None = None
    since_ns: int | None = None
    """UTC since when traffic is what it is; None: not known."""
    stopped: int = 0
    """Vehicles that stand as in no queue."""

    @property
    def platoons_allowed(self) -> bool:
        """Whether platoons may drive close on it now: an open gate, and traffic still stable."""
        return self.traffic == "stable" and (self.gate_open or self.gate_cycle is None)


@dataclass(frozen=True)
class RsuView:
    """Health of one roadside unit; its rates are None if its health is stale."""

    rsu: str
    status: str
    level: Level
    fps: float | None
    latency_ms: float | None
    skipped_share: float
    age_s: float
    health: RsuHealth


@dataclass(frozen=True)
class PreviewView:
    """The latest picture of one roadside unit."""

    jpeg: bytes
    age_s: float
    stale: bool


@dataclass(frozen=True)
class VehicleView:
    """One vehicle's plan and position: the reported one, of a silent vehicle the last one that it
    reported, of one that was never heard the planned one.

    A vehicle is idle if its plan is empty, or if the last cycle gave it none, which voids an older
    one. It then has no route and stops. A silent one is never idle: what it does is not known.

    Attributes:
        colour: number of its colour, 0 to 11.
        plan: that it follows; an empty one of a vehicle that is idle.
        open_roads: roads on which platoons may drive close now.
        progress: what it does.
        expired: its plan has run out.
        charge_kwh: in its battery, as it reports.
        silent_ns: UTC of its last position; None: it is heard, or never was.
        silence: how bad that is: not at all of one without plan and orders; None likewise.
    """

    colour: int
    plan: VehiclePlan
    open_roads: Container[str]
    progress: Progress
    expired: bool = False
    charge_kwh: float | None = None
    silent_ns: int | None = None
    silence: Literal["idle", "warn", "bad"] | None = None

    @property
    def vehicle(self) -> str:
        """Its name."""
        return self.plan.vehicle

    @property
    def rgb(self) -> Rgb:
        """Its colour."""
        return VEHICLE_RGB[self.colour]

    @property
    def idle(self) -> bool:
        """It has no plan to follow."""
        return self.progress.state == "idle"

    @property
    def position(self) -> tuple[str, float] | None:
        """(segment, fraction of it driven); None if unknown."""
        return self.progress.position

    # Made where it is asked for: the operator's page keeps its own of each plan.
    @cached_property
    def route(self) -> tuple[tuple[str, str | None], ...]:
        """(segment, platoon or None) in driving order; a platoon only where it may be close now."""
        return tuple(
            (part.segment, part.platoon if part.segment in self.open_roads else None)
            for part in self.plan.segments
        )


def platoon_km(plan: VehiclePlan) -> float:
    """How far a plan leads in platoons."""
    return sum(
        part.speed_mps * (part.exit_ns - part.entry_ns) / 1e12
        for part in plan.segments
        if part.platoon is not None
    )

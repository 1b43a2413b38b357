"""The view model: all that the page shows at one moment, as plain data."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

from dashboard.view.labels import Level, Rgb, Traffic
from dashboard.view.progress import Progress
from slipstream.messages import RsuHealth, SolverReport, Unserved, VehiclePlan

LIST_FOR_S: Final = 24 * 3600.0
"""Vehicles are listed this long after their plan expired, RSUs this long after their health, s."""


@dataclass(frozen=True)
class RoadView:
    """One watched road segment: the traffic on it now, and its gate in the last cycle.

    ``speed_kmh``, ``cv`` (standard deviation of speed over its mean) and
    ``acceleration_variance`` (m²/s⁴) are None where traffic is unknown.
    """

    segment: str
    rsu: str
    traffic: Traffic
    reason: str
    speed_kmh: float | None
    cv: float | None
    acceleration_variance: float | None
    age_s: float | None
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
    latency_ms_p50: float | None
    latency_ms_p95: float | None
    frames_skipped: int
    skipped_share: float
    age_s: float
    segments: tuple[str, ...]
    vehicles_in_view: int
    health: RsuHealth


@dataclass(frozen=True)
class PreviewView:
    """The latest picture of one roadside unit."""

    rsu: str
    jpeg: bytes
    age_s: float
    stale: bool
    level: Level


@dataclass(frozen=True)
class VehicleView:
    """One vehicle's plan and position: the reported one, of a silent vehicle the last one that it
    reported, of one that was never heard the planned one.

    A vehicle is idle if its plan is empty, or if the last cycle gave it none, which voids an older
    one. It then has no route and stops. A silent one is never idle: what it does is not known.

    Attributes:
        vehicle: its name.
        rgb: its colour.
        colour: number of the colour, 0 to 11.
        plan: that it follows; an empty one of a vehicle that is idle.
        open_roads: roads on which platoons may drive close now.
        progress: what it does.
        activity: the same in words, with times.
        expired: its plan has run out.
        charge_kwh: in its battery, as it reports.
        silent_ns: UTC of its last position; None: it is heard, or never was.
        silence: how bad that is: not at all of one without plan and orders; None likewise.
    """

    vehicle: str
    rgb: Rgb
    colour: int
    plan: VehiclePlan
    open_roads: Container[str]
    progress: Progress
    activity: str
    expired: bool = False
    charge_kwh: float | None = None
    silent_ns: int | None = None
    silence: Literal["idle", "warn", "bad"] | None = None

    @property
    def idle(self) -> bool:
        """It has no plan to follow."""
        return self.progress.state == "idle"

    @property
    def cycle(self) -> int:
        """Of its plan."""
        return self.plan.cycle

    @property
    def position(self) -> tuple[str, float] | None:
        """(segment, fraction of it driven); None if unknown."""
        return self.progress.position

    @property
    def energy_kwh(self) -> float:
        """Of its plan."""
        return self.plan.energy_kwh

    @property
    def distance_km(self) -> float:
        """Of its plan."""
        return self.plan.distance_m / 1000

    # Made where they are asked for: the operator's page keeps its own of each plan.
    @cached_property
    def route(self) -> tuple[tuple[str, str | None], ...]:
        """(segment, platoon or None) in driving order; a platoon only where it may be close now."""
        return tuple(
            (part.segment, part.platoon if part.segment in self.open_roads else None)
            for part in self.plan.segments
        )

    @cached_property
    def stops(self) -> tuple[tuple[str, str], ...]:
        """(stop, node) in driving order."""
        return tuple((stop.stop, stop.node) for stop in self.plan.stops)

    @cached_property
    def platoon_km(self) -> float:
        """Of its plan."""
        return platoon_km(self.plan)


def platoon_km(plan: VehiclePlan) -> float:
    """How far a plan leads in platoons."""
    return sum(
        part.speed_mps * (part.exit_ns - part.entry_ns) / 1e12
        for part in plan.segments
        if part.platoon is not None
    )


@dataclass(frozen=True)
class EnergyView:
    """Energy of the last cycle's plans and of their baseline."""

    baseline: str
    baseline_kwh: float
    cooperative_kwh: float
    saved_kwh: float
    saved_share: float
    saved_distance_kwh: float
    saved_drag_kwh: float
    saved_acceleration_kwh: float
    platooned_km: float
    baseline_driving_s: float | None
    cooperative_driving_s: float | None


@dataclass(frozen=True)
class CycleView:
    """The last dispatch cycle."""

    number: int
    age_s: float
    status: str
    level: Level
    reason: str
    solver: str
    objective_kwh: float | None
    feasible: bool | None
    variables: int
    wall_s: float
    plans: int
    energy: EnergyView | None
    solvers: tuple[SolverReport, ...]
    unserved: tuple[Unserved, ...]


@dataclass(frozen=True)
class HistoryView:
    """Energy per cycle, oldest first; cycles without energy are omitted."""

    cycles: tuple[int, ...] = ()
    baseline_kwh: tuple[float, ...] = ()
    cooperative_kwh: tuple[float, ...] = ()


@dataclass(frozen=True)
class DashboardView:
    """All that the page shows at one moment."""

    headline: str
    headline_level: Level
    dispatcher: str
    dispatcher_level: Level
    roads: tuple[RoadView, ...]
    rsus: tuple[RsuView, ...]
    previews: tuple[PreviewView, ...]
    vehicles: tuple[VehicleView, ...]
    cycle: CycleView | None
    history: HistoryView
    problems: tuple[str, ...]
    device: tuple[str, Level] | None = None
    """Status line of the quantum device and its level; None without one, or if health is stale."""

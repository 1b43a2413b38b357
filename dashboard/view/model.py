"""The view model: all that the page shows at one moment, as plain data."""

from __future__ import annotations

from dataclasses import dataclass

from dashboard.view.labels import Level, Rgb, Traffic
from slipstream.messages import SolverReport, Unserved


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
    """One vehicle's plan and position; the position is the reported one, else the planned one.

    A vehicle is idle if its plan is empty, or if the last cycle gave it none, which voids an older
    one. It then has no route, stops and position.
    """

    vehicle: str
    rgb: Rgb
    cycle: int
    expired: bool
    idle: bool
    route: tuple[tuple[str, str | None], ...]
    """(segment, platoon or None) in driving order."""
    stops: tuple[tuple[str, str], ...]
    """(stop, node) in driving order."""
    position: tuple[str, float] | None
    """(segment, fraction of it driven); None if unknown."""
    activity: str
    distance_km: float
    platoon_km: float
    energy_kwh: float


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

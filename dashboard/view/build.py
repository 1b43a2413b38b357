"""What the 3D view shows at one moment; pure.

Fail safe: data that is stale or dated ahead is shown as unknown, never with its last value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dashboard.live import Snapshot
from dashboard.view.dispatcher import SILENT_AFTER_S, energy_status, hardware_status
from dashboard.view.labels import Level
from dashboard.view.model import RoadView, RsuView, VehicleView
from dashboard.view.roads import open_roads, road_limits, road_views
from dashboard.view.rsus import rsu_views
from dashboard.view.troubles import Trouble, troubles
from dashboard.view.vehicles import vehicle_views
from slipstream import freshness


@dataclass(frozen=True)
class DashboardView:
    """All that the 3D view shows at one moment."""

    headline: tuple[str, Level]
    energy: str | None
    device: tuple[str, Level] | None
    troubles: tuple[Trouble, ...]
    roads: tuple[RoadView, ...]
    rsus: tuple[RsuView, ...]
    vehicles: tuple[VehicleView, ...]


def build_view(snapshot: Snapshot, now_ns: int, stale_after_s: float) -> DashboardView:
    """Build the view model. Road data are judged by the limits that the dispatcher publishes.

    Args:
        stale_after_s: age above which RSU health is stale, s; for road data too where the
            dispatcher has published no limit.
    """
    rsus = rsu_views(snapshot.rsus, now_ns, stale_after_s)
    roads = road_views(snapshot, now_ns, road_limits(snapshot.dispatcher, stale_after_s))
    vehicles = vehicle_views(snapshot, now_ns, open_roads(roads))
    return DashboardView(
        headline=_headline(roads),
        energy=energy_status(snapshot.cycles, now_ns),
        device=_device(snapshot, now_ns),
        troubles=troubles(snapshot, roads, rsus, vehicles, now_ns),
        roads=roads,
        rsus=rsus,
        vehicles=vehicles,
    )


def _device(snapshot: Snapshot, now_ns: int) -> tuple[str, Level] | None:
    health = snapshot.dispatcher
    if health is None or health.hardware is None:
        return None
    if freshness.fault(health.time_ns, now_ns, stale_after_s=SILENT_AFTER_S) is not None:
        return None
    return hardware_status(health.hardware)


def _headline(roads: Sequence[RoadView]) -> tuple[str, Level]:
    if not roads:
        return "Waiting for the first roadside camera", "warn"
    stable = sum(road.traffic == "stable" for road in roads)
    level: Level = "ok" if stable else "warn"
    if len(roads) == 1:
        return f"Traffic is {roads[0].traffic} on the watched road", level
    return f"Traffic is calm on {stable} of {len(roads)} watched roads", level

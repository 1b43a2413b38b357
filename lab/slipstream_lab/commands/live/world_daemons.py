"""Settings of the daemons around a live world."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.config import Settings
from slipstream_lab.commands.live.demo import agents, write_daemons
from slipstream_lab.commands.live.local import scene_port_of

if TYPE_CHECKING:
    from slipstream_lab.simulation.live.world_spec import CameraEndpoint, WorldSpec


def write_world_settings(
    folder: Path,
    order: WorldSpec,
    cameras: Sequence[CameraEndpoint],
    *,
    bus_endpoint: str,
    dashboard_port: int,
    interval_s: float,
) -> dict[str, tuple[str, Path]]:
    """Write one settings file a daemon.

    Returns:
        For each process name the sub-command to run and its settings file.
    """
    from dashboard.settings import DashboardSettings
    from dispatcher_daemon.settings import DispatcherSettings
    from edge_daemon.settings import EdgeSettings
    from slipstream_lab.simulation.closed_loop.gates import WINDOW_S
    from slipstream_lab.simulation.closed_loop.policy import Policy

    bus = {"connect": [bus_endpoint]}
    rsus = {camera.rsu: tuple(camera.segments) for camera in cameras}
    url = f"sqlite:///{(folder / 'slipstream.db').absolute()}"
    net = str(order.day.net.absolute())
    keep_s = {rsu.id: rsu.keep_s for rsu in order.rsus}
    daemons: dict[str, tuple[str, Settings]] = {
        camera.rsu: (
            "edge",
            EdgeSettings.model_validate(
                {
                    "rsu": camera.rsu,
                    "camera": camera.calibration.absolute(),
                    "source": {"url": camera.url},
                    # In less, too few vehicles come by most of the day to tell anything.
                    "window_s": WINDOW_S,
                    "stability": {"keep_s": keep_s[camera.rsu]},
                    # Several cameras on one small machine: a thread each, not all cores for all.
                    "detector": {"threads": 1},
                    "bus": bus,
                }
            ),
        )
        for camera in cameras
    }
    daemons["dispatcher"] = (
        "dispatcher",
        DispatcherSettings.model_validate(
            {
                "bus": bus,
                "rsus": rsus,
                "database_url": url,
                "network": net,
                "fleet": str(order.fleet.absolute()),
                "interval_s": interval_s,
                "deadline_s": min(10.0, interval_s / 2),
                "form": "route",
                "solvers": ["exact"],
                "advice": {
                    "eco_approach": True,
                    "coasting_budget": Policy("live").coasting_budget,
                    "signal_priority": order.priority,
                },
            }
        ),
    )
    daemons["agents"] = agents(order, folder / "agents", bus)
    depots = [depot.node for depot in order.deliveries.settings.depots]
    daemons["dashboard"] = (
        "dashboard",
        DashboardSettings.model_validate(
            {
                "bus": bus,
                "rsus": rsus,
                "database_url": url,
                "network": net,
                "depots": depots,
                "port": dashboard_port,
                "scene_port": scene_port_of(dashboard_port),
            }
        ),
    )
    return write_daemons(folder / "settings", daemons)

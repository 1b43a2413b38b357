"""The site around a live world."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream_cli.place.site_file import SiteSpec
from slipstream_lab.commands.live.demo import agents

if TYPE_CHECKING:
    from slipstream_lab.simulation.live.world_spec import CameraEndpoint, WorldSpec


def place_of_world(
    folder: Path,
    order: WorldSpec,
    cameras: Sequence[CameraEndpoint],
    *,
    bus_endpoint: str,
    dashboard_port: int,
    interval_s: float,
) -> SiteSpec:
    """What the world's site.toml says."""
    from slipstream_lab.simulation.closed_loop.gates import WINDOW_S

    keep_s = {rsu.id: rsu.keep_s for rsu in order.rsus}
    return SiteSpec(
        network=str(order.day.net.absolute()),
        fleet=str(order.fleet.absolute()),
        database=folder / "slipstream.db",
        endpoint=bus_endpoint,
        port=dashboard_port,
        rsus={
            camera.rsu: {
                "segments": list(camera.segments),
                "camera": camera.calibration.absolute(),
                "source": {"url": camera.url},
                "stability": {"keep_s": keep_s[camera.rsu]},
            }
            for camera in cameras
        },
        agents={"vans": agents(order, folder / "agents")},
        edge={
            # In less, too few vehicles come by most of the day to tell anything.
            "window_s": WINDOW_S,
            # Several cameras on one small machine: a thread each, not all cores for all.
            "detector": {"threads": 1},
        },
        dispatcher={
            "interval_s": interval_s,
            "deadline_s": min(10.0, interval_s / 2),
            "form": "route",
            **({"advice": {"signal_priority": True}} if order.priority else {}),
        },
    )

"""The files of a new place, which agree with each other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from slipstream.config import check
from slipstream_cli.place.commented import commented
from slipstream_cli.place.layout import Layout
from slipstream_cli.place.site_file import SiteSpec, tables_of
from slipstream_cli.settings_doc import sections, site_sections

_ENDPOINT: Final = "tcp/127.0.0.1:7447"
METRICS_PORTS: Final = {"edge": 9464, "dispatcher": 9465, "dashboard": 9466, "agents": 9467}
"""By daemon's table, as of the units that `deploy/install.sh` sets up."""

AGENTS: Final = "vans"
"""Name of the process of all agents."""

# A made-up camera of 1280 by 720 px on a mast: points in the picture, and on the road in m.
_POINTS: Final = (
    ([478.4, 631.0], [20.3, 7.3]),
    ([1123.6, 568.5], [20.3, -7.3]),
    ([440.8, 365.9], [42.8, 7.3]),
    ([790.9, 349.1], [42.8, -7.3]),
    ([421.1, 226.8], [90.0, 7.3]),
    ([599.4, 222.8], [90.0, -7.3]),
)
_LANE_M: Final = 3.5
_NEAR_M: Final = 20.0


@dataclass(frozen=True)
class PlaceSite:
    """A new place.

    Attributes:
        folder: of its files, absolute.
        net: SUMO net, absolute, or "demo".
        layout: its first places.
        rsu: name of its roadside unit.
        vans: number of vans.
        port: of the page; the 3D view has the next one.
    """

    folder: Path
    net: str
    layout: Layout
    rsu: str
    vans: int
    port: int


def files_of(site: PlaceSite) -> dict[str, str]:
    """By file name its text, with comments.

    Raises:
        InputError: something of it is not valid.
    """
    from dispatcher_daemon.fleet import Fleet
    from edge_daemon.settings import CameraSettings

    lay, folder = site.layout, site.folder
    vans = [f"van-{number + 1}" for number in range(site.vans)]
    far_m, wide_m = _NEAR_M + lay.view_m, 0.3 + _LANE_M * lay.lanes
    polygon = [[_NEAR_M, 0.3], [far_m, 0.3], [far_m, wide_m], [_NEAR_M, wide_m]]
    fleet = {
        "name": folder.name or "fleet",
        "depots": [{"id": "depot", "node": lay.depot}],
        "stops": [{"id": f"stop-{k + 1}", "node": node} for k, node in enumerate(lay.stops)],
        "vehicles": [{"id": name, "depot": "depot", "type": "van"} for name in vans],
    }
    camera = {
        "schema": 1,
        "name": site.rsu,
        "image": {"width": 1280, "height": 720},
        "points": [{"image": image, "road": road} for image, road in _POINTS],
        "segments": [
            {
                "id": lay.watched,
                "polygon": polygon,
                "direction": [-1.0, 0.0],
                "lanes": lay.lanes,
                "lane_width_m": _LANE_M,
            }
        ],
    }
    place = SiteSpec(
        network=site.net,
        fleet=str(folder / "fleet.toml"),
        database=folder / "slipstream.db",
        endpoint=_ENDPOINT,
        port=site.port,
        rsus={
            site.rsu: {
                "segments": [lay.watched],
                "camera": folder / f"camera-{site.rsu}.toml",
                "source": {"url": "rtsp://viewer:secret@192.168.1.20:554/stream1"},
            }
        },
        agents={
            AGENTS: {
                "vehicles": [{"id": name, "type": {"preset": "van"}} for name in vans],
                "state": folder / "agents",
            }
        },
        # At its defaults, each key with its meaning: signal priority is for the city to allow.
        dispatcher={"advice": {}},
        metrics_ports=METRICS_PORTS,
    )
    check(fleet, Fleet, "fleet.toml")
    check(camera, CameraSettings, f"camera-{site.rsu}.toml")
    return {
        "fleet.toml": commented(
            sections(Fleet),
            fleet,
            "The fleet: its depot, the stops of today and its vans. The dispatcher reads it again "
            "whenever it has changed. Stops are made up: put in your own, by node or by lat and "
            "lon. `slipstream net find` finds junctions. Times: docs/fleet.md.",
        ),
        f"camera-{site.rsu}.toml": commented(
            sections(CameraSettings),
            camera,
            "Calibration of the camera and what it watches. The points belong to a MADE-UP camera: "
            "measure your own with `slipstream calibrate` before you trust a flag "
            "(docs/calibration.md).",
        ),
        "site.toml": commented(
            site_sections(),
            tables_of(place),
            "All daemons of the site: `slipstream dispatcher --config FILE`, and so dashboard, "
            "agent and edge. What they share stands at the top, then what is each one's own. Put "
            "in your camera's address.",
            {"rsus": site.rsu, "agents": AGENTS},
        ),
    }

"""The built-in demo: two roadside clips, and the site around them."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from slipstream import __version__
from slipstream.config import DEMO_NETWORK
from slipstream.errors import InputError
from slipstream.service import SUPERVISED
from slipstream.site import DEMO_FLEET
from slipstream_cli.place.site_file import SiteSpec

if TYPE_CHECKING:
    from slipstream_lab.simulation.live.world_spec import WorldSpec


@dataclass(frozen=True)
class DemoRoadside:
    """One RSU of the demo: clips of one camera, watched as that road segment."""

    rsu: str
    segment: str
    seed: int
    clips: tuple[str, ...]


ROADSIDES: Final = (
    # A wave's tours take some eight minutes: gates that close more often than that leave it no
    # platoons. Periods of 9 and 6½ minutes; the second one begins turbulent.
    DemoRoadside("rsu-east", "avenue_east", 1, ("stable",) * 16 + ("turbulent",) * 2),
    DemoRoadside("rsu-west", "avenue_west", 2, ("turbulent",) + ("stable",) * 11 + ("turbulent",)),
)
_SECONDS: Final = 30
_FPS: Final = 15
"""Ten are enough for speeds and flags; thirty would take all of two cores for two cameras."""


def make_clips(folder: Path, stopping: threading.Event) -> dict[str, dict[str, Path]]:
    """Render the missing clips in parallel.

    Returns:
        The folder of each RSU's clips, by scenario; some are missing if it was stopped.

    Raises:
        InputError: rendering failed; the renderer has said why.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for left_over in folder.glob("*.part"):
        shutil.rmtree(left_over, ignore_errors=True)
    clips = {
        roadside.rsu: {s: folder / _name(roadside, s) for s in sorted({*roadside.clips})}
        for roadside in ROADSIDES
    }
    missing = [
        (roadside, scenario, path)
        for roadside in ROADSIDES
        for scenario, path in clips[roadside.rsu].items()
        if not path.is_dir()
    ]
    with ThreadPoolExecutor(len(ROADSIDES)) as pool:
        for future in [pool.submit(_render, *clip, stopping) for clip in missing]:
            future.result()
    return clips


def _name(roadside: DemoRoadside, scenario: str) -> str:
    form = f"{roadside.seed}-{_SECONDS}s-{_FPS}fps"
    return f"{roadside.segment}-{scenario}-{form}-v{__version__}"


def _render(roadside: DemoRoadside, scenario: str, target: Path, stopping: threading.Event) -> None:
    unfinished = target.with_name(f"{target.name}.{os.getpid()}.part")
    options = {
        "--out": str(unfinished),
        "--seconds": str(_SECONDS),
        "--fps": str(_FPS),
        "--scenario": scenario,
        "--seed": str(roadside.seed),
        "--segment": roadside.segment,
    }
    command = [sys.executable, "-m", "slipstream_cli", "clip", "streetdrive"]
    process = subprocess.Popen(
        [*command, *(word for option in options.items() for word in option)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
        env=os.environ | {SUPERVISED: str(os.getpid())},
    )
    while process.poll() is None and not stopping.wait(0.1):
        pass
    if process.poll() is None:
        process.kill()
    status = process.wait()
    if status == 0:
        with contextlib.suppress(OSError):  # another run may have made the same clip meanwhile
            unfinished.rename(target)
    shutil.rmtree(unfinished, ignore_errors=True)
    if status != 0 and not stopping.is_set():
        raise InputError(target, f"the clip could not be rendered (status {status})", "see above")


def place_of_demo(
    clips: Mapping[str, Mapping[str, Path]],
    *,
    bus_endpoint: str,
    database: Path,
    dashboard_port: int,
    interval_s: float,
    hardware: str = "",
    town: WorldSpec | None = None,
    tours: Path | None = None,
) -> SiteSpec:
    """What the demo's site.toml says. `town`: whose vans are dispatched and have agents; None: the
    two vans of the demo's fleet.
    """
    return SiteSpec(
        network=DEMO_NETWORK,
        fleet=DEMO_FLEET if town is None else str(town.fleet.absolute()),
        database=database,
        endpoint=bus_endpoint,
        port=dashboard_port,
        rsus={
            roadside.rsu: {
                "segments": [roadside.segment],
                # The same in all of them: the seed decides it.
                "camera": clips[roadside.rsu]["stable"] / "camera.toml",
                "source": {
                    "clip": [clips[roadside.rsu][s] / "video.mp4" for s in roadside.clips],
                    "loop": True,
                },
            }
            for roadside in ROADSIDES
        },
        agents={} if town is None or tours is None else {"vans": agents(town, tours)},
        # Two cameras on one small machine: a thread each, not all cores for both.
        edge={"detector": {"threads": 1}},
        dispatcher={
            "interval_s": interval_s,
            "deadline_s": min(10.0, interval_s / 2),
            **({"hardware": _device(hardware)} if hardware else {}),
            **({} if town is None else _of_town()),
        },
    )


def _of_town() -> dict[str, object]:
    """Settings of its dispatcher."""
    return {
        "form": "route",
        # Two thirds less time than the default, and half of the samples valid: decision 292.
        "effort": "fast",
        "lc_qaoa": {"variant": "one-hot"},
    }


def agents(world: WorldSpec, folder: Path) -> dict[str, object]:
    """The agents of a world's vehicles, in one process. `folder`: for their tours; those of a
    world before are over.
    """
    from slipstream_lab.simulation.sumo import TYPES

    shutil.rmtree(folder, ignore_errors=True)
    kind = world.deliveries.settings.vehicle_type
    own = {"preset": kind.preset, "length_m": kind.length_m or TYPES["cav"].length_m}
    vehicles = [{"id": name, "type": own} for name in world.deliveries.vehicles]
    return {"vehicles": vehicles, "state": folder.absolute()}


def _device(backend: str) -> dict[str, object]:
    """A fake device costs this machine's time only: few shots, and a budget for many jobs."""
    of_fake = {"shots": 256, "budget_s_per_day": 3600.0} if backend.startswith("fake:") else {}
    return {"backend": backend, **of_fake}

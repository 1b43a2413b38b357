"""The built-in demo: two roadside clips, and the settings of all daemons around them."""

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

import tomli_w

from slipstream import __version__
from slipstream.config import Settings
from slipstream.errors import InputError
from slipstream.service import SUPERVISED
from slipstream_lab.commands.live.local import scene_port_of

if TYPE_CHECKING:
    from slipstream_lab.simulation.live.world_spec import WorldSpec
    from vehicle_agent.settings import AgentSettings


@dataclass(frozen=True)
class DemoRoadside:
    """One RSU of the demo: clips of one camera, watched as that road segment.

    Attributes:
        clips: scenarios in the order in which they are played, again and again.
    """

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

    Args:
        folder: where they are kept between runs.
        stopping: set from outside to stop.

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


def write_settings(
    folder: Path,
    clips: Mapping[str, Mapping[str, Path]],
    *,
    bus_endpoint: str,
    database: Path,
    dashboard_port: int,
    interval_s: float,
    hardware: str = "",
    town: WorldSpec | None = None,
) -> dict[str, tuple[str, Path]]:
    """Write one settings file a daemon.

    Args:
        hardware: a quantum device, see `HardwareSettings.backend`.
        town: whose vans are dispatched and have agents; None: the two vans of the demo's fleet.

    Returns:
        For each process name the sub-command to run and its settings file.
    """
    from dashboard.settings import DashboardSettings
    from dispatcher_daemon.settings import DispatcherSettings
    from edge_daemon.settings import EdgeSettings

    bus = {"connect": [bus_endpoint]}
    rsus = {roadside.rsu: (roadside.segment,) for roadside in ROADSIDES}
    url = f"sqlite:///{database.absolute()}"
    daemons: dict[str, tuple[str, Settings]] = {
        roadside.rsu: (
            "edge",
            EdgeSettings.model_validate(
                {
                    "rsu": roadside.rsu,
                    # The same in all of them: the seed decides it.
                    "camera": clips[roadside.rsu]["stable"] / "camera.toml",
                    "source": {
                        "clip": [clips[roadside.rsu][s] / "video.mp4" for s in roadside.clips],
                        "loop": True,
                    },
                    # Two cameras on one small machine: a thread each, not all cores for both.
                    "detector": {"threads": 1},
                    "bus": bus,
                }
            ),
        )
        for roadside in ROADSIDES
    }
    daemons["dispatcher"] = (
        "dispatcher",
        DispatcherSettings.model_validate(
            {
                "bus": bus,
                "rsus": rsus,
                "database_url": url,
                "interval_s": interval_s,
                "deadline_s": min(10.0, interval_s / 2),
                **({"hardware": _device(hardware)} if hardware else {}),
                **({} if town is None else _of_town(town)),
            }
        ),
    )
    if town is not None:
        daemons["agents"] = agents(town, folder.parent / "agents", bus)
    daemons["dashboard"] = (
        "dashboard",
        DashboardSettings.model_validate(
            {
                "bus": bus,
                "rsus": rsus,
                "database_url": url,
                "fleet": None if town is None else str(town.fleet.absolute()),
                "port": dashboard_port,
                "scene_port": scene_port_of(dashboard_port),
            }
        ),
    )
    return write_daemons(folder, daemons)


def _of_town(town: WorldSpec) -> dict[str, object]:
    """Settings of its dispatcher."""
    from slipstream_lab.simulation.closed_loop.policy import Policy

    return {
        "fleet": str(town.fleet.absolute()),
        "form": "route",
        # Two thirds less time than the default, and half of the samples valid: decision 292.
        "lc_qaoa": {"variant": "one-hot", "layers": 1, "iterations": 20, "shots": 512},
        "advice": {"coasting_budget": Policy("town").coasting_budget},
    }


def agents(world: WorldSpec, folder: Path, bus: Mapping[str, object]) -> tuple[str, AgentSettings]:
    """The agents of a world's vehicles, in one process: sub-command and settings.

    Args:
        world: whose vehicles stand at their depots when it begins.
        folder: for their tours; those of a world before are over.
        bus: settings.
    """
    from slipstream_lab.simulation.sumo import TYPES
    from vehicle_agent.settings import AgentSettings

    shutil.rmtree(folder, ignore_errors=True)
    vehicles = [
        {"id": name, "type": {"length_m": TYPES["cav"].length_m}}
        for name in world.deliveries.vehicles
    ]
    settings = {"bus": bus, "vehicles": vehicles, "state": folder.absolute()}
    return "agent", AgentSettings.model_validate(settings)


def write_daemons(
    folder: Path, daemons: Mapping[str, tuple[str, Settings]]
) -> dict[str, tuple[str, Path]]:
    """Write the settings of daemons into a folder, made if missing.

    Args:
        daemons: sub-command and settings of each process.

    Returns:
        Sub-command and settings file of each process.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = {}
    for name, (command, settings) in daemons.items():
        path = folder / f"{name}.toml"
        path.write_text(
            tomli_w.dumps(settings.model_dump(mode="json", exclude_unset=True, exclude_none=True))
        )
        files[name] = (command, path)
    return files


def _device(backend: str) -> dict[str, object]:
    """A fake device costs this machine's time only: few shots, and a budget for many jobs."""
    of_fake = {"shots": 256, "budget_s_per_day": 3600.0} if backend.startswith("fake:") else {}
    return {"backend": backend, **of_fake}

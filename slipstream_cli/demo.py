"""The built-in demo: two roadside clips, and the settings of all daemons around them."""

from __future__ import annotations

import os
import shutil
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import tomli_w

from slipstream import __version__
from slipstream.config import Settings


@dataclass(frozen=True)
class Roadside:
    """One RSU of the demo: a clip of that scenario, watched as that road segment."""

    rsu: str
    segment: str
    scenario: str
    seed: int


ROADSIDES: Final = (
    Roadside("rsu-east", "avenue_east", "stable", 1),
    Roadside("rsu-west", "avenue_west", "turbulent", 2),
)
_SECONDS: Final = 30.0
_FPS: Final = 30


def make_clips(folder: Path) -> dict[str, Path]:
    """Render the clips that are not there yet, side by side.

    Returns:
        The folder of each RSU's clip.
    """
    folder.mkdir(parents=True, exist_ok=True)
    clips = {r.rsu: folder / _name(r) for r in ROADSIDES}
    missing = [r for r in ROADSIDES if not clips[r.rsu].is_dir()]
    if missing:
        with ProcessPoolExecutor(len(missing), mp_context=get_context("spawn")) as pool:
            list(pool.map(_render, missing, [clips[r.rsu] for r in missing]))
    return clips


def _name(roadside: Roadside) -> str:
    return f"{roadside.segment}-{roadside.scenario}-{roadside.seed}-{_SECONDS:g}s-v{__version__}"


def _render(roadside: Roadside, target: Path) -> None:
    from simulation.streetdrive.clip import ClipSettings, render_clip

    unfinished = target.with_name(f"{target.name}.{os.getpid()}.part")
    render_clip(
        ClipSettings(
            seconds=_SECONDS,
            fps=_FPS,
            scenario=roadside.scenario,
            seed=roadside.seed,
            segment_id=roadside.segment,
        ),
        unfinished,
    )
    try:
        unfinished.rename(target)
    except OSError:  # another run has made the same clip meanwhile
        shutil.rmtree(unfinished, ignore_errors=True)


def write_settings(
    folder: Path,
    clips: dict[str, Path],
    *,
    bus_endpoint: str,
    database: Path,
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

    bus = {"connect": [bus_endpoint]}
    url = f"sqlite:///{database.absolute()}"
    folder.mkdir(parents=True, exist_ok=True)
    daemons: dict[str, tuple[str, Settings]] = {
        roadside.rsu: (
            "edge",
            EdgeSettings.model_validate(
                {
                    "rsu": roadside.rsu,
                    "camera": clips[roadside.rsu] / "camera.toml",
                    "source": {"clip": clips[roadside.rsu] / "video.mp4", "loop": True},
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
                "database_url": url,
                "interval_s": interval_s,
                "deadline_s": min(10.0, interval_s / 2),
            }
        ),
    )
    daemons["dashboard"] = (
        "dashboard",
        DashboardSettings.model_validate({"bus": bus, "database_url": url, "port": dashboard_port}),
    )
    files = {}
    for name, (command, settings) in daemons.items():
        path = folder / f"{name}.toml"
        path.write_text(
            tomli_w.dumps(settings.model_dump(mode="json", exclude_unset=True, exclude_none=True))
        )
        files[name] = (command, path)
    return files

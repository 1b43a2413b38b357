"""One run of everything: the clip, the runners in turns, the daemons."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from edge_daemon.detection import builtin_model
from slipstream.errors import InputError
from slipstream_lab.benchmarks.aims import Load, machine
from slipstream_lab.benchmarks.perception import report
from slipstream_lab.benchmarks.perception.daemons import DaemonRun, run_daemons
from slipstream_lab.benchmarks.perception.report import (
    LIVE,
    ROAD,
    SAME_EXPORT,
    TORCH,
    TORCH_ALL,
    WHOLE,
    PerceptionResults,
)
from slipstream_lab.benchmarks.perception.speed import Speed, last_line, measured, speed_of

CAMERA_FPS: Final = 45.6
"""What one frame in the 21.9 ms of the paper amounts to."""

OVERLOAD_FPS: Final = 60.0
_OVERLOAD_CLIP_S = 10.0
_OVERLOAD_WARM_UP_S = 15.0
"""Published latencies are of the last ten seconds: those of the beginning are not judged."""

SETTLING_S: Final = 300.0
"""Not judged: allocators and windows fill up. Set before, not after looking at a run."""

_TIME_LIMIT_S = 900.0


@dataclass(frozen=True)
class PerceptionBenchSettings:
    """How long and on what.

    Attributes:
        clip: folder of the clip; rendered if it is not there.
        frames: a turn of ours; peers take a quarter, at least 30.
        peer_python: Python that has Ultralytics; None or absent: its runs are left out.
        cameras_s: how long two daemons run in real time; 0: not at all.
        overload_s: how long two of 60 frames a second run beside a busy process; 0: not at all.
        memory_s: how long a daemon runs at full speed; 0: not at all.
    """

    out: Path = Path(".slipstream/bench-perception")
    clip: Path = Path(".slipstream/clips/bench-mixed-4-20s")
    clip_seconds: float = 20.0
    rounds: int = 3
    frames: int = 600
    peer_python: Path | None = Path(".venv-train/bin/python")
    cameras_s: float = 600.0
    overload_s: float = 60.0
    memory_s: float = 1800.0


def run_bench(settings: PerceptionBenchSettings, say: Callable[[str], None]) -> PerceptionResults:
    """Measure all and write the report.

    Raises:
        InputError: the output folder cannot be used.
        RuntimeError: one of our own runs failed.
    """
    try:
        settings.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(settings.out, f"{error.strerror}", "choose another --out") from None
    log = settings.out / "runs.log"
    log.unlink(missing_ok=True)
    _render(settings.clip, settings.clip_seconds, CAMERA_FPS, say)
    load = Load()
    missing: list[str] = []
    peer = _peer(settings, missing)
    rounds = []
    for number in range(1, settings.rounds + 1):
        say(f"round {number} of {settings.rounds}")
        rounds.append(_round(settings, peer, log, missing))
    cameras: tuple[DaemonRun, ...] = ()
    if settings.cameras_s > 0:
        say(f"two cameras in real time, {settings.cameras_s:.0f} s")
        cameras = tuple(
            run_daemons(
                settings.clip,
                settings.out,
                ("camera-1", "camera-2"),
                "real_time",
                settings.cameras_s,
                warm_up_s=min(10.0, settings.cameras_s / 3),
            )
        )
    overload: tuple[DaemonRun, ...] = ()
    if settings.overload_s > 0:
        clip = settings.clip.with_name(f"{settings.clip.name}-overload")
        _render(clip, _OVERLOAD_CLIP_S, OVERLOAD_FPS, say)
        say(f"two cameras beside a busy process, {settings.overload_s:.0f} s")
        with _busy_process():
            overload = tuple(
                run_daemons(
                    clip,
                    settings.out,
                    ("overload-1", "overload-2"),
                    "real_time",
                    settings.overload_s,
                    warm_up_s=_OVERLOAD_WARM_UP_S,
                )
            )
    fast = None
    if settings.memory_s > 0:
        say(f"a daemon at full speed, {settings.memory_s:.0f} s")
        (fast,) = run_daemons(
            settings.clip,
            settings.out,
            ("fast",),
            "fast",
            settings.memory_s,
            warm_up_s=min(SETTLING_S, settings.memory_s / 3),
        )
    results = PerceptionResults(
        tuple(rounds), cameras, overload, fast, tuple(dict.fromkeys(missing))
    )
    report.write(settings.out, results, _about(settings, load))
    return results


def _render(clip: Path, seconds: float, fps: float, say: Callable[[str], None]) -> None:
    """A clip of 720p; a part of one is never taken for it."""
    if (clip / "camera.toml").is_file():
        return
    from slipstream_lab.simulation.streetdrive import ClipSettings, render_clip

    say(f"rendering {seconds:.0f} s of video")
    part = clip.with_name(f"{clip.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    render_clip(ClipSettings(seconds=seconds, fps=fps, scenario="mixed", seed=4), part)
    part.rename(clip)


@contextmanager
def _busy_process() -> Iterator[None]:
    """One that takes what the scheduler gives it of a processor."""
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def _peer(settings: PerceptionBenchSettings, missing: list[str]) -> Path | None:
    python = settings.peer_python
    if python is None or not python.is_file():
        missing.append(f"Ultralytics: no {python}; make one with `make train-venv`")
        return None
    found = subprocess.run(
        [python, "-c", "import ultralytics, torch"], capture_output=True, check=False
    )
    if found.returncode != 0:
        missing.append(f"Ultralytics: {python} cannot import it")
        return None
    return python


def _round(
    settings: PerceptionBenchSettings, peer: Path | None, log: Path, missing: list[str]
) -> dict[str, Speed]:
    """Each runner once, one after the other, so that a busy minute hits them alike."""
    ours = [
        *(sys.executable, "-m", "slipstream_lab.benchmarks.perception.ours", str(settings.clip)),
        *("--frames", str(settings.frames)),
    ]
    speeds = {ROAD: measured(ours, log, _TIME_LIMIT_S)}
    if peer is not None:
        weights = builtin_model()
        with tempfile.TemporaryDirectory(suffix="_openvino_model") as folder:
            for file in (weights, weights.with_suffix(".bin")):
                shutil.copy(file, folder)
            shutil.copy(
                weights.with_name("yolo11n-streetdrive.metadata.yaml"),
                Path(folder) / "metadata.yaml",
            )
            torch_weights = str(weights.with_name("yolo11n-streetdrive.pt"))
            for name, options in (
                (TORCH, [torch_weights]),
                (TORCH_ALL, [torch_weights, "--all-cores"]),
                (SAME_EXPORT, [folder]),
            ):
                try:
                    speeds[name] = _measured_peer(settings, peer, options, log)
                except (RuntimeError, subprocess.TimeoutExpired) as error:
                    missing.append(f"{name}: {error}")
    speeds[LIVE] = measured([*ours, "--live"], log, _TIME_LIMIT_S)
    speeds[WHOLE] = measured([*ours, "--whole-picture"], log, _TIME_LIMIT_S)
    return speeds


def _measured_peer(
    settings: PerceptionBenchSettings, python: Path, options: list[str], log: Path
) -> Speed:
    model, *flags = options
    command = [
        *(str(python), str(Path(__file__).with_name("peer.py")), model),
        *(str(settings.clip / "video.mp4"), "--frames", str(max(30, settings.frames // 4))),
        *flags,
    ]
    result = last_line(command, log, _TIME_LIMIT_S)
    return speed_of(result["done_s"], [], result["cpu_s"], result["vehicles"], result["rss_mb"])


def _about(settings: PerceptionBenchSettings, load: Load) -> dict[str, object]:
    return {
        "machine": machine(),
        **load.figures(),
        "clip": f"{settings.clip}, 1280×720",
        "rounds": f"{settings.rounds} of {settings.frames} frames; peers a quarter of them",
        "date": time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()),
    }

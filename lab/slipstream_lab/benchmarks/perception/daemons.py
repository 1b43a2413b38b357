"""Real edge daemons on a looped clip: frames skipped in real time, memory at full speed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import psutil
import tomli_w

from slipstream.bus import Bus, Router
from slipstream.config import BusSettings
from slipstream.messages import RsuHealth
from slipstream_lab.benchmarks.observer import BusObserver
from slipstream_lab.benchmarks.perception.slope import MemoryUse, memory_use

_START_LIMIT_S = 60.0
_STOP_LIMIT_S = 15.0


@dataclass(frozen=True)
class DaemonRun:
    """One daemon over the time that was judged. `latency_ms_p95`: median of the published values,
    from the decoded picture on, ms.
    """

    rsu: str
    seconds: float
    frames: int
    skipped: int
    fps: float
    latency_ms_p95: float | None
    cpu_cores: float
    memory: MemoryUse


@dataclass
class _Daemon:
    process: subprocess.Popen[bytes]
    times_s: list[float]
    rss_mb: list[float]
    cpu_s: list[float]

    def sample(self, at_s: float) -> None:
        process = psutil.Process(self.process.pid)
        with process.oneshot():
            used = process.cpu_times()
            self.times_s.append(at_s)
            self.rss_mb.append(process.memory_info().rss / 1e6)
            self.cpu_s.append(used.user + used.system)


def run_daemons(
    clip: Path,
    folder: Path,
    rsus: Sequence[str],
    pace: Literal["real_time", "fast"],
    seconds: float,
    warm_up_s: float,
    on_progress: Callable[[float], None] = lambda at_s: None,
) -> list[DaemonRun]:
    """Start an edge daemon for each name, all on the same clip, and watch them. Raises
    RuntimeError: a daemon did not come up, or ended.
    """
    began = time.monotonic()

    def clock() -> float:
        return time.monotonic() - began

    observer = BusObserver(clock)
    with ExitStack() as stack:
        router = stack.enter_context(Router())
        bus = stack.enter_context(Bus.open(BusSettings(connect=(router.endpoint,))))
        observer.listen(bus)
        daemons = {
            rsu: stack.enter_context(_daemon(clip, folder, rsu, pace, router.endpoint))
            for rsu in rsus
        }
        _wait(daemons, observer, folder)
        up_s = clock()
        while (now_s := clock()) < up_s + warm_up_s + seconds:
            for rsu, daemon in daemons.items():
                if daemon.process.poll() is not None:
                    raise RuntimeError(f"{rsu} ended; see {folder / rsu}.log")
                if now_s >= up_s + warm_up_s:
                    daemon.sample(now_s)
            on_progress(now_s - up_s)
            time.sleep(max(0.0, 1.0 - (clock() - now_s)))
    return [
        _judged(rsu, daemon, observer.rsus[rsu], up_s + warm_up_s)
        for rsu, daemon in daemons.items()
    ]


@contextmanager
def _daemon(clip: Path, folder: Path, rsu: str, pace: str, endpoint: str) -> Iterator[_Daemon]:
    path = folder / f"{rsu}.toml"
    settings = {
        "rsus": {
            rsu: {
                "camera": str(clip / "camera.toml"),
                "source": {"clip": str(clip / "video.mp4"), "loop": True, "pace": pace},
            }
        },
        "bus": {"connect": [endpoint]},
    }
    path.write_text(tomli_w.dumps(settings))
    with (folder / f"{rsu}.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "slipstream_cli", "edge", "--config", str(path)],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )
        try:
            yield _Daemon(process, [], [], [])
        finally:
            process.terminate()
            try:
                process.wait(_STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _wait(daemons: dict[str, _Daemon], observer: BusObserver, folder: Path) -> None:
    """Wait until each daemon reports processed frames."""
    deadline = time.monotonic() + _START_LIMIT_S
    while time.monotonic() < deadline:
        for rsu, daemon in daemons.items():
            if daemon.process.poll() is not None:
                raise RuntimeError(f"{rsu} did not come up; see {folder / rsu}.log")
        if all(any(h.frames for _, h in observer.rsus.get(rsu, ())) for rsu in daemons):
            return
        time.sleep(0.1)
    raise RuntimeError(f"the daemons did not come up; see {folder}")


def _judged(
    rsu: str, daemon: _Daemon, heard: Sequence[tuple[float, RsuHealth]], begin_s: float
) -> DaemonRun:
    after = [(at_s, health) for at_s, health in heard if at_s >= begin_s]
    if len(after) < 2:
        raise RuntimeError(f"{rsu} published no health")
    (first_s, first), (last_s, last) = after[0], after[-1]
    p95 = sorted(h.latency_ms_p95 for _, h in after if h.latency_ms_p95 is not None)
    seconds = last_s - first_s
    return DaemonRun(
        rsu=rsu,
        seconds=seconds,
        frames=last.frames - first.frames,
        skipped=last.frames_skipped - first.frames_skipped,
        fps=(last.frames - first.frames) / seconds,
        latency_ms_p95=p95[len(p95) // 2] if p95 else None,
        cpu_cores=(daemon.cpu_s[-1] - daemon.cpu_s[0])
        / max(daemon.times_s[-1] - daemon.times_s[0], 1e-3),
        memory=memory_use(daemon.times_s, daemon.rss_mb),
    )

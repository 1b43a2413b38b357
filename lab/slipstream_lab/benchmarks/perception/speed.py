"""What a run through a clip took, from the moments at which its frames were done."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

BLOCK: Final = 30
"""Frames whose time is taken together: results of a pipeline come in bursts."""


@dataclass(frozen=True)
class Speed:
    """One run. `latency_ms_p50, latency_ms_p95`: of a frame, from the begin of its decoding until
    it was tracked and, where one was due, the states were made; None where not measured.
    """

    frames: int
    ms_per_frame: float
    ms_per_frame_p95: float
    latency_ms_p50: float | None
    latency_ms_p95: float | None
    cpu_ms_per_frame: float
    vehicles_per_frame: float
    rss_mb: float


def speed_of(
    done_s: npt.ArrayLike,
    latencies_s: Sequence[float],
    cpu_s: float,
    vehicles: int,
    rss_mb: float,
) -> Speed:
    """Figures of a run. `done_s`: when each frame was done, in order, and before them when the
    last frame of the warm-up was; shape (frames + 1,).
    """
    done = np.asarray(done_s, dtype=np.float64)
    frames = len(done) - 1
    block = min(BLOCK, frames)
    per_frame_ms = 1e3 * (done[block:] - done[:-block])[::block] / block
    p50, p95 = (
        np.percentile(1e3 * np.asarray(latencies_s), (50, 95)) if latencies_s else (None,) * 2
    )
    return Speed(
        frames=frames,
        ms_per_frame=float(np.median(per_frame_ms)),
        ms_per_frame_p95=float(np.percentile(per_frame_ms, 95)),
        latency_ms_p50=None if p50 is None else float(p50),
        latency_ms_p95=None if p95 is None else float(p95),
        cpu_ms_per_frame=1e3 * cpu_s / frames,
        vehicles_per_frame=vehicles / frames,
        rss_mb=rss_mb,
    )


def written(speed: Speed) -> str:
    """One line of JSON, as the measuring processes print it."""
    return json.dumps(asdict(speed))


def measured(command: Sequence[str], log: Path, timeout_s: float) -> Speed:
    """The figures that a measuring process prints as its last line. Raises RuntimeError: it
    failed, or printed something else; the log has what it said.
    """
    return Speed(**last_line(command, log, timeout_s))


def last_line(command: Sequence[str], log: Path, timeout_s: float) -> dict[str, Any]:
    """Run a process and read the JSON object that it prints as its last line. Raises RuntimeError:
    it failed, or printed nothing; the log has what it said.
    """
    with log.open("a") as errors:
        done = subprocess.run(
            command,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        errors.write(done.stdout)
    lines = done.stdout.strip().splitlines()
    if done.returncode != 0 or not lines:
        raise RuntimeError(f"{command[0]} failed with status {done.returncode}; see {log}")
    result: dict[str, Any] = json.loads(lines[-1])
    return result

"""`python -m slipstream_lab.benchmarks.accuracy.drawn`: σ²_a and the flag of drawn windows, whose
truth is known: is what is stated of them true?
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from edge_daemon.camera import Array, WatchedSegment
from edge_daemon.features import SegmentKinematics, classify
from edge_daemon.settings import StabilitySettings
from edge_daemon.tracking import Sightings
from slipstream_cli.progress import ProgressLine
from slipstream_cli.tables import markdown_table

Process = Literal["matern", "exponential", "sine"]
"""How accelerations vary in time: as the smoother takes for granted, with kinks, or in waves."""

PROCESSES: Final[tuple[Process, ...]] = ("matern", "exponential", "sine")
WINDOW_S: Final = 10.0
_FPS: Final = 25.0
_CORRELATION_S: Final = 2.5
_NEAR: Final = 0.1
"""Windows nearer to a threshold than this share of it are neither turbulent nor calm."""


@dataclass(frozen=True)
class Draw:
    """A window.

    Attributes:
        variance: of the accelerations' process, m²/s⁴.
        noise_m: standard deviation of a position.
    """

    process: Process
    vehicles: int
    length_m: float
    speed_mps: float
    variance: float
    noise_m: float


@dataclass(frozen=True)
class Judged:
    """What was found, beside the truth: σ²_a, its value and standard error, and the flag."""

    true: float
    true_cv: float
    value: float
    error: float
    y_e: int | None


@dataclass(frozen=True)
class Honesty:
    """Of some windows: shares.

    Attributes:
        within: of intervals of 1.96 standard errors, that hold the truth.
        wrongly_stable: of the turbulent windows, that are called stable.
        wrongly_turbulent: of the calm ones, that are called turbulent.
        unknown: of all.
    """

    windows: int
    turbulent: int
    within: float
    wrongly_stable: float
    wrongly_turbulent: float
    unknown: float


def drawn(rng: np.random.Generator, process: Process) -> Draw:
    """A window of the envelope."""
    return Draw(
        process,
        vehicles=int(rng.integers(3, 11)),
        length_m=float(rng.uniform(40.0, 150.0)),
        speed_mps=float(rng.uniform(8.0, 33.0)),
        variance=float(np.exp(rng.uniform(np.log(0.02), np.log(3.0)))),
        noise_m=float(rng.uniform(0.3, 1.0)),
    )


def judge(draw: Draw, rng: np.random.Generator) -> Judged | None:
    """Drive the vehicles, see them with noise as a detector's, and measure; None: nothing was."""
    length, speed = draw.length_m, draw.speed_mps
    outline = np.array([[0.0, -6.0], [length, -6.0], [length, 6.0], [0.0, 6.0]])
    segment = WatchedSegment("s", outline, np.array([1.0, 0.0]), length, 3, 4.0)
    parts, true, driven = [], [], []
    for number in range(draw.vehicles):
        own_mps = speed * (1 + 0.04 * rng.standard_normal())
        enters_s = rng.uniform(0.0, max(0.5, WINDOW_S - length / own_mps))
        time = np.arange(enters_s, min(WINDOW_S, enters_s + 1.5 * length / own_mps), 1 / _FPS)
        accelerations = _accelerations(draw, time, rng)
        speeds = own_mps + np.cumsum(accelerations) / _FPS
        along = np.cumsum(speeds) / _FPS
        inside = (along >= 0) & (along <= length)
        time, along = time[inside], along[inside]
        true.append(accelerations[inside])
        driven.append(speeds[inside])
        noise = np.sqrt(0.6) * _noise(time, 1.0, rng) + np.sqrt(0.4) * _noise(time, 0.05, rng)
        parts.append(_sightings(number, time, along + draw.noise_m * noise, draw.noise_m))
    measured = SegmentKinematics(segment, None).features(Sightings.join(parts), 0.0, WINDOW_S)
    if measured is None:
        return None
    variance = measured.features.acceleration_variance_m2ps4
    frames = round(WINDOW_S * _FPS)
    vehicles, rule = len(measured.vehicles), StabilitySettings()
    flag = classify(measured.features, vehicles, frames, 1.0, rule, variance=measured.variance)
    every, realised = np.concatenate(driven), float(np.concatenate(true).var())
    cv = float(every.std() / every.mean())
    return Judged(realised, cv, variance.value, variance.standard_error or 0.0, flag.y_e)


def honesty(found: Sequence[Judged], rule: StabilitySettings) -> Honesty:
    """How often what is stated is true."""
    names = ("true", "true_cv", "value", "error")
    true, cv, value, error = (np.array([getattr(one, name) for one in found]) for name in names)
    over = np.maximum(true / rule.max_acceleration_variance_m2ps4, cv / rule.max_speed_cv)
    turbulent, calm = over > 1 + _NEAR, over < 1 - _NEAR
    stable = np.array([judged.y_e == 1 for judged in found])
    rough = np.array([judged.y_e == 0 for judged in found])
    return Honesty(
        windows=len(found),
        turbulent=int(turbulent.sum()),
        within=float(np.mean(np.abs(value - true) <= 1.96 * error)),
        wrongly_stable=float(stable[turbulent].mean()) if turbulent.any() else 0.0,
        wrongly_turbulent=float(rough[calm].mean()) if calm.any() else 0.0,
        unknown=float(np.mean(~stable & ~rough)),
    )


def _accelerations(draw: Draw, time: Array, rng: np.random.Generator) -> Array:
    std = np.sqrt(draw.variance)
    if draw.process == "sine":
        period_s, phase = rng.uniform(4.0, 12.0), rng.uniform(0.0, 2 * np.pi)
        return np.asarray(np.sqrt(2) * std * np.sin(2 * np.pi * time / period_s + phase))
    return np.asarray(std * _noise(time, _CORRELATION_S, rng, smooth=draw.process == "matern"))


def _noise(
    time: Array, correlation_s: float, rng: np.random.Generator, *, smooth: bool = False
) -> Array:
    """Of unit variance, with an exponential correlation or a Matérn-3/2 one."""
    if not len(time):
        return time
    apart = np.abs(time[:, None] - time) / correlation_s
    if smooth:
        apart *= np.sqrt(3.0)
    correlation = (1 + apart) * np.exp(-apart) if smooth else np.exp(-apart)
    root = np.linalg.cholesky(correlation + 1e-9 * np.eye(len(time)))
    return np.asarray(root @ rng.standard_normal(len(time)))


def _sightings(track: int, time: Array, along: Array, noise_m: float) -> Sightings:
    n = len(time)
    across = np.full(n, (track % 3 - 1) * 4.0)
    return Sightings(
        np.full(n, track, dtype=np.int64),
        time,
        np.column_stack([along, across]),
        np.tile(np.diag([noise_m**2, 0.1**2]), (n, 1, 1)),
        np.zeros((n, 2)),
        np.zeros(n, dtype=np.int64),
        np.tile(np.array([0, 0, 40, 40], dtype=np.float32), (n, 1)),
    )


def table(found: dict[str, Honesty]) -> str:
    """One row a process."""
    columns = (
        *("accelerations", "windows", "turbulent", "intervals hold"),
        *("of turbulent: stable", "of calm: turbulent", "unknown"),
    )
    rows = (
        (
            name,
            str(one.windows),
            str(one.turbulent),
            f"{one.within:.1%}",
            f"{one.wrongly_stable:.1%}",
            f"{one.wrongly_turbulent:.1%}",
            f"{one.unknown:.1%}",
        )
        for name, one in found.items()
    )
    return markdown_table(columns, rows)


def measure(process: Process, windows: int, seed: int) -> list[Judged]:
    """Draw windows of one process and judge them."""
    rng = np.random.default_rng([seed, PROCESSES.index(process)])
    found = (judge(drawn(rng, process), rng) for _ in range(windows))
    return [judged for judged in found if judged is not None]


def main() -> int:
    """Run it; 1 if an interval or a flag is less honest than stated."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.accuracy.drawn", description=__doc__
    )
    parser.add_argument("--windows", type=int, default=500, help="of each process")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="also write all figures into a file")
    options = parser.parse_args()
    found: dict[str, Honesty] = {}
    with ProgressLine("processes", sys.stderr) as progress:
        for done, process in enumerate(PROCESSES, start=1):
            judged = measure(process, options.windows, options.seed)
            found[process] = honesty(judged, StabilitySettings())
            progress.update(done, len(PROCESSES))
    print(table(found))
    if options.json:
        figures = {name: asdict(one) for name, one in found.items()}
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    missed = [
        f"{name}: {what}"
        for name, one in found.items()
        for what, holds in (
            (
                f"intervals hold {one.within:.1%}, not 90 to 99 %",
                0.9 <= one.within <= 0.99 or name != "matern",
            ),
            (f"{one.wrongly_stable:.1%} called stable, not 2 %", one.wrongly_stable <= 0.02),
        )
        if not holds
    ]
    for miss in missed:
        print(f"missed: {miss}")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())

"""What is measured on instances and cities, and the arithmetic on it; no I/O."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, median
from typing import Final

import numpy as np

SAME_KWH: Final = 1e-6
"""Objectives that differ by less are the same."""


@dataclass(frozen=True)
class SolverAnswer:
    """One solver on one named instance. `objective_kwh`: of the worst repeat; None if one gave no
    valid answer.
    """

    wall_s: tuple[float, ...]
    objective_kwh: float | None
    optimal: bool


@dataclass(frozen=True)
class InstanceRow:
    """One named instance."""

    name: str
    variables: int
    optimum_kwh: float
    answers: dict[str, SolverAnswer]

    def solved(self, solver: str) -> bool:
        """True if the solver's answers are all the optimum."""
        found = self.answers[solver].objective_kwh
        return found is not None and abs(found - self.optimum_kwh) <= SAME_KWH


@dataclass(frozen=True)
class CityRun:
    """One cycle of one generated city.

    Attributes:
        saved_stops_kwh: expected energy of stops at signals and junctions saved on it, counted
            from planning speeds; `saved_acceleration_kwh` has it in it.
        rival_kwh: cost of the routes that PyVRP finds for the whole fleet by its own defaults,
            without platooning; None: it was not asked.
    """

    seed: int
    vehicles: int
    stops: int
    segments: int
    solver_seed: int
    budget_s: float
    wall_s: float
    cpu_s: float
    peak_mb: float
    objective_kwh: float
    cost_kwh: float
    saving_kwh: float
    base_kwh: float
    base_met_kwh: float
    greedy_kwh: float
    base_driven_kwh: float
    saved_distance_kwh: float
    saved_drag_kwh: float
    saved_acceleration_kwh: float
    saved_stops_kwh: float
    driving_h: float
    base_driving_h: float
    unserved: int
    sweeps: int
    blocks: int
    timed_out: bool
    stages_s: dict[str, float]
    rival_kwh: float | None = None
    rival_cpu_s: float = 0.0


@dataclass(frozen=True)
class Gap:
    """Block-wise sweeps against the undivided optimum over the same options."""

    seed: int
    vehicles: int
    variables: int
    blocks: int
    start_kwh: float
    sweep_kwh: float
    optimum_kwh: float
    proven: bool
    exact_s: float

    @property
    def share(self) -> float:
        """(swept − optimum) / |optimum|."""
        return relative(self.sweep_kwh, self.optimum_kwh)

    @property
    def gained(self) -> float:
        """Share of what the optimum gains on the start that the sweeps gain; 1 where none can."""
        most = self.start_kwh - self.optimum_kwh
        return (self.start_kwh - self.sweep_kwh) / most if most > 0 else 1.0


@dataclass(frozen=True)
class RivalSpread:
    """Of some values."""

    mean: float
    least: float
    median: float
    most: float


def spread(values: Sequence[float]) -> RivalSpread:
    """Mean and spread of at least one value."""
    return RivalSpread(fmean(values), min(values), median(values), max(values))


def relative(value: float, reference: float) -> float:
    """(value − reference) / |reference|; positive: value is the larger one."""
    return (value - reference) / abs(reference)


def saved_share(value: float, reference: float) -> float:
    """How much less than the reference, as a share of it."""
    return -relative(value, reference)


def log_slope(sizes: Sequence[float], times_s: Sequence[float]) -> float:
    """Exponent b of times ≈ a · sizes^b: the least-squares slope of the logarithms. Raises
    ValueError: fewer than two different sizes, or a value that is not positive.
    """
    if len(set(sizes)) < 2 or min(*sizes, *times_s) <= 0:
        raise ValueError("a slope needs two sizes and positive times")
    slope, _ = np.polyfit(np.log(sizes), np.log(times_s), 1)
    return float(slope)


def medians_by_size(runs: Sequence[CityRun]) -> list[tuple[int, float]]:
    """(vehicles, median wall time in s) by fleet size."""
    sizes = sorted({run.vehicles for run in runs})
    return [(n, median(run.wall_s for run in runs if run.vehicles == n)) for n in sizes]

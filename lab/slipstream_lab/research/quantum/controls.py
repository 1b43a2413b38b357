"""Controls: samples without a circuit under the same post-processing, and differences to them.

Controls cost time and change no plan: they belong to tools and benchmarks, not to dispatch cycles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from dispatcher_daemon.forms import QuboModel, RouteProblem
from dispatcher_daemon.solvers import BitDistribution, Histogram, Outcome, Samples, stages

Stage = Literal["raw", "descended", "repaired"]

STAGES: Final[tuple[Stage, ...]] = ("raw", "descended", "repaired")

UNIFORM_BITS: Final = "uniform bits"
UNIFORM_OPTIONS: Final = "uniform options"

_OFFSET: Final = 10_007
"""Offset of the controls' seeds from those of the samples."""


@dataclass(frozen=True)
class StageShares:
    """One stage of a sample.

    Attributes:
        p_feasible: share of the shots that are valid.
        p_optimal: share of the shots that are valid with the best objective; None if it is unknown.
        best_kwh: lowest objective among them; None without a valid one.
    """

    p_feasible: float
    p_optimal: float | None
    best_kwh: float | None


@dataclass(frozen=True)
class Difference:
    """A share less that of a control.

    Attributes:
        value: difference of the two shares of shots.
        standard_error: of the difference: Agresti and Caffo's, one shot of either kind added to
            each sample, so that it is not 0 where no shot hit.
    """

    value: float
    standard_error: float


def histogram_of(samples: Samples, stage: Stage) -> Histogram:
    """The histogram of a stage."""
    return {"raw": samples.raw, "descended": samples.descended, "repaired": samples.repaired}[stage]


def shares(samples: Samples, stage: Stage, optimum_kwh: float | None) -> StageShares:
    """Shares of one stage against the exact or best known objective."""
    histogram = histogram_of(samples, stage)
    return StageShares(
        p_feasible=samples.share(histogram),
        p_optimal=None if optimum_kwh is None else samples.share(histogram, optimum_kwh),
        best_kwh=min((value for value, _ in histogram), default=None),
    )


def difference(share: float, shots: int, control: float, control_shots: int) -> Difference:
    """Difference of two shares of independent shots."""

    def variance(p: float, n: int) -> float:
        p = (p * n + 1) / (n + 2)
        return p * (1 - p) / (n + 2)

    error = math.sqrt(variance(share, shots) + variance(control, control_shots))
    return Difference(share - control, error)


def uniform_bits(n: int) -> BitDistribution:
    """Independent bits with P(1) = 0.5."""
    return BitDistribution((0.5,) * n)


def uniform_choices(n: int, groups: Sequence[Sequence[int]]) -> BitDistribution:
    """One member of each group, all equally likely; bits outside the groups have P(1) = 0.5."""
    probabilities = [0.5] * n
    for group in groups:
        for i in group:
            probabilities[i] = 1 / len(group)
    return BitDistribution(tuple(probabilities), tuple(tuple(group) for group in groups))


def distributions(model: QuboModel, outcome: Outcome) -> dict[str, BitDistribution]:
    """Uniform bits, uniform options of each vehicle (route form), and the outcome's own."""
    n = len(model.variables)
    found = {UNIFORM_BITS: uniform_bits(n)}
    if isinstance(model.problem, RouteProblem):
        groups = [group for group in model.problem.options_of.values() if group]
        found[UNIFORM_OPTIONS] = uniform_choices(n, groups)
    return found | dict(outcome.controls)


def run_controls(
    model: QuboModel, of: Mapping[str, BitDistribution], shots: int, seed: int
) -> dict[str, Samples]:
    """As many samples of each distribution, through the same stages.

    Args:
        seed: of the samples' own draw; the controls' are other ones.
    """
    found = {}
    for number, (name, distribution) in enumerate(of.items()):
        bits = distribution.sample(shots, seed + _OFFSET * (number + 1))
        rows, counts = np.unique(bits, axis=0, return_counts=True)
        found[name], _ = stages(model, rows, counts, seed)
    return found

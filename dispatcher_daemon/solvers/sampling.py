"""Post-processing of QUBO samples: raw, descended and repaired stages, and the best answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms import (
    BinaryProblem,
    Encoding,
    Problem,
    QuboModel,
    RouteProblem,
    build_model,
    violations,
)
from dispatcher_daemon.solvers.arc_repair import follow_arcs
from dispatcher_daemon.solvers.distribution import BitDistribution
from dispatcher_daemon.solvers.protocol import Execution, Histogram, Outcome, Samples

Bits = npt.NDArray[np.int8]
"""Samples by variable of the model, shape (samples, variables)."""

Counts = npt.NDArray[np.int64]
"""How often each sample was drawn, shape (samples,)."""


@dataclass(frozen=True)
class SampledBits:
    """Samples with their counts and origin.

    Attributes:
        qubits: width of the circuit, if there was one.
        execution, controls: see `Outcome`.
    """

    bits: Bits
    counts: Counts
    qubits: int | None = None
    execution: Execution | None = None
    controls: tuple[tuple[str, BitDistribution], ...] = ()


def solve_by_sampling(
    solver: str,
    problem: Problem,
    gamma: float | None,
    encoding: Encoding,
    seed: int,
    draw: Callable[[QuboModel], SampledBits | None],
) -> Outcome:
    """Build the QUBO, sample it, and post-process the samples.

    Args:
        seed: of the post-processing.
        draw: samples the QUBO; None if it had no time to.
    """
    began = time.perf_counter()
    model = build_model(problem, gamma, encoding=encoding)
    if not model.variables:
        reason = "the problem has nothing to choose"
        return Outcome(solver, "failed", None, time.perf_counter() - began, reason=reason)
    drawn = draw(model)
    if drawn is None:
        reason = "no time left for a search"
        return Outcome(solver, "timeout", None, time.perf_counter() - began, reason=reason)
    return answer(
        solver,
        model,
        drawn.bits,
        drawn.counts,
        seed,
        began,
        qubits=drawn.qubits,
        execution=drawn.execution,
        controls=drawn.controls,
    )


def answer(
    solver: str,
    model: QuboModel,
    bits: Bits,
    counts: Counts,
    seed: int,
    began: float,
    *,
    qubits: int | None = None,
    execution: Execution | None = None,
    controls: tuple[tuple[str, BitDistribution], ...] = (),
) -> Outcome:
    """The best valid selection of all stages; a raw one where post-processing finds no better.

    Args:
        seed: of the post-processing.
        began: `time.perf_counter` at the request.
        qubits: width of the circuit, if there was one.
    """
    samples, (raw, *processed) = stages(model, bits, counts, seed, qubits)
    found = [best for best in processed if best is not None]
    best, repaired = min(found, default=None, key=lambda pair: pair[0]), True
    if raw is not None and (best is None or raw[0] <= best[0] + 1e-12):
        best, repaired = raw, False
    return Outcome(
        solver=solver,
        status="failed" if best is None else "feasible",
        selected=None if best is None else best[1],
        wall_s=time.perf_counter() - began,
        repaired=best is not None and repaired,
        samples=samples,
        reason="no sample led to a valid route set" if best is None else None,
        execution=execution,
        controls=controls,
    )


Best = tuple[float, frozenset[int]]
"""Objective in kWh and selection of the best valid sample."""


def stages(
    model: QuboModel, bits: Bits, counts: Counts, seed: int, qubits: int | None = None
) -> tuple[Samples, list[Best | None]]:
    """The samples of each stage (see `Samples`), and the best of each: raw, descended, repaired."""
    descended = descend(model, bits, seed)
    if isinstance(model.problem, RouteProblem):
        repaired = descend(model, one_option_each(model, bits), seed)
    elif isinstance(model.problem, BinaryProblem):
        repaired = descended
    else:
        repaired = follow_arcs(model.problem, descended[:, : model.problem.choices])
    histograms, best = _valid_samples(model.problem, (bits, descended, repaired), counts)
    return Samples(qubits, int(counts.sum()), *histograms), best


def one_option_each(model: QuboModel, bits: Bits) -> Bits:
    """Each vehicle in turn keeps the best of its selected options; of all, if none is selected.

    The best is the one with the least H_total, the other vehicles' bits as they are at that point.
    """
    problem = model.problem
    if not isinstance(problem, RouteProblem):
        raise TypeError("only route problems have options")
    n = len(model.variables)
    vectors = model.total.to_numpy_vectors(variable_order=model.variables)
    rows, columns, values = vectors.quadratic
    coupling = np.zeros((n, n))
    coupling[rows, columns] = values
    coupling += coupling.T
    result = np.array(bits, dtype=np.int8)
    samples = np.arange(len(result))
    for options in problem.options_of.values():
        if not options:
            continue
        group = np.array(options)
        selected = result[:, group].astype(bool)
        selected[~selected.any(axis=1)] = True
        result[:, group] = 0
        energies = vectors.linear_biases[group] + result @ coupling[:, group]
        best = np.where(selected, energies, np.inf).argmin(axis=1)
        result[samples, group[best]] = 1
    return result


def descend(model: QuboModel, bits: Bits, seed: int) -> Bits:
    """Each state's local minimum of the full QUBO under one-flip steepest descent."""
    import dimod
    from dwave.samplers import SteepestDescentSolver

    sample_set: Any = dimod.SampleSet
    start = sample_set.from_samples_bqm((bits, list(model.variables)), model.total)
    solver: Any = SteepestDescentSolver
    result = solver().sample(
        model.total, initial_states=start, num_reads=len(bits), seed=seed % 2**32
    )
    return in_order(model, result)


def in_order(model: QuboModel, sample_set: Any) -> Bits:
    """Rows of a `dimod.SampleSet`, columns in the order of the model's variables."""
    column = {variable: i for i, variable in enumerate(sample_set.variables)}
    columns = [column[variable] for variable in model.variables]
    return np.asarray(sample_set.record.sample, dtype=np.int8)[:, columns]


def _valid_samples(
    problem: Problem, of_stages: Sequence[Bits], counts: Counts
) -> tuple[list[Histogram], list[Best | None]]:
    """Samples of each stage by objective, those that decode to routes; and the best of each."""
    selections = np.concatenate([bits[:, : problem.choices] for bits in of_stages])
    patterns, inverse = np.unique(selections, axis=0, return_inverse=True)
    judged: list[Best | None] = []
    for pattern in patterns:
        selected = frozenset(np.flatnonzero(pattern).tolist())
        valid = not violations(problem, selected)
        judged.append((problem.objective_kwh(selected), selected) if valid else None)
    histograms: list[Histogram] = []
    best: list[Best | None] = []
    for rows in inverse.reshape(len(of_stages), -1):
        weights = np.bincount(rows, weights=counts, minlength=len(patterns)).astype(np.int64)
        found: dict[float, int] = {}
        winner: Best | None = None
        for i in np.flatnonzero(weights):
            pair = judged[i]
            if pair is None:
                continue
            # Routes that swap like parts differ in the last bits of a sum only.
            key = round(pair[0], 9)
            found[key] = found.get(key, 0) + int(weights[i])
            if winner is None or pair[0] < winner[0]:
                winner = pair
        histograms.append(tuple(sorted(found.items())))
        best.append(winner)
    return histograms, best

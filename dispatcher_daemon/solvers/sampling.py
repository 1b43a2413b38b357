"""From samples of a QUBO to an answer: what they are as drawn, repaired, and the best of both."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.decode import violations
from dispatcher_daemon.formulations.model import QuboModel
from dispatcher_daemon.problem import Problem, RouteProblem
from dispatcher_daemon.solvers.base import Outcome, Samples

Bits = npt.NDArray[np.int8]
"""Samples by variable of the model, shape (samples, variables)."""


def answer(
    solver: str,
    model: QuboModel,
    bits: Bits,
    counts: npt.NDArray[np.int64],
    seed: int,
    began: float,
    *,
    qubits: int | None = None,
) -> Outcome:
    """The best valid selection among the samples as drawn and repaired.

    Args:
        solver: name of the solver.
        bits: samples.
        counts: how often each was drawn, shape (samples,).
        seed: of the repair.
        began: `time.perf_counter` at the request.
        qubits: width of the circuit, if there was one.
    """
    raw, best_raw = _valid_samples(model.problem, bits, counts)
    repaired, best_repaired = _valid_samples(model.problem, repair(model, bits, seed), counts)
    best, needed_repair = best_repaired, True
    if best_raw is not None and (best is None or best_raw[0] <= best[0] + 1e-12):
        best, needed_repair = best_raw, False
    return Outcome(
        solver=solver,
        status="failed" if best is None else "feasible",
        selected=None if best is None else best[1],
        wall_s=time.perf_counter() - began,
        repaired=best is not None and needed_repair,
        samples=Samples(qubits, int(counts.sum()), raw, repaired),
        reason="no sample led to a valid route set" if best is None else None,
    )


def repair(model: QuboModel, bits: Bits, seed: int) -> Bits:
    """Each sample after post-processing: one option for each vehicle, then `descend`."""
    if isinstance(model.problem, RouteProblem):
        bits = one_option_each(model, bits)
    return descend(model, bits, seed)


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
    problem: Problem, bits: Bits, counts: npt.NDArray[np.int64]
) -> tuple[tuple[tuple[float, int], ...], tuple[float, frozenset[int]] | None]:
    """Samples by objective of those that decode to routes, and the best (objective, selection)."""
    patterns, inverse = np.unique(bits[:, : problem.choices], axis=0, return_inverse=True)
    weights = np.bincount(inverse.ravel(), weights=counts).astype(np.int64)
    found: dict[float, int] = {}
    best: tuple[float, frozenset[int]] | None = None
    for pattern, weight in zip(patterns, weights, strict=True):
        selected = frozenset(int(i) for i in np.flatnonzero(pattern))
        if violations(problem, selected):
            continue
        value = problem.objective_kwh(selected)
        # Routes that swap like parts differ in the last bits of a sum only.
        key = round(value, 9)
        found[key] = found.get(key, 0) + int(weight)
        if best is None or value < best[0]:
            best = (value, selected)
    return tuple(sorted(found.items())), best

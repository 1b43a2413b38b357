"""Exact probabilities of valid and optimal selections in a simulated QAOA state."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms import QuboModel
from dispatcher_daemon.solvers.quantum import to_ising
from dispatcher_daemon.solvers.quantum.statevector import (
    ExactState,
    Objective,
    Schedule,
    StateVector,
    cost_diagonal,
    train,
)
from slipstream_lab.research.proofs.enumeration import valid_selections

_SAME_KWH = 1e-9


@dataclass(frozen=True)
class ValidSelections:
    """Valid selections of a problem, and which of them are optimal.

    Attributes:
        choices: bits of a selection; auxiliary bits of a state lie above them.
        valid: their numbers, bit i for choice i, ascending; shape (valid,).
        optimal: shape (valid,).
    """

    choices: int
    valid: npt.NDArray[np.int64]
    optimal: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Figures:
    """Plain QAOA of one instance, exactly.

    Attributes:
        qubits: of the state.
        p_feasible, p_optimal: probability of a valid, of an optimal selection, as drawn.
        uniform_feasible, uniform_optimal: the same of uniformly random bits.
        schedule: angles for the Hamiltonian divided by its largest coefficient.
        evaluations: of training, on this instance.
        wall_s: all of it.
    """

    qubits: int
    p_feasible: float
    p_optimal: float
    uniform_feasible: float
    uniform_optimal: float
    schedule: tuple[tuple[float, float], ...]
    evaluations: int
    wall_s: float


def valid_selections_of(model: QuboModel) -> ValidSelections:
    """By the decoder, for any values of the auxiliary bits."""
    problem = model.problem
    valid = np.flatnonzero(valid_selections(problem))
    values = np.array(
        [
            problem.objective_kwh([i for i in range(problem.choices) if number >> i & 1])
            for number in valid.tolist()
        ]
    )
    optimal = values <= values.min(initial=np.inf) + _SAME_KWH
    return ValidSelections(problem.choices, valid, optimal)


def shares(state: ExactState, selections: ValidSelections, qubits: int) -> tuple[float, float]:
    """P_feas and P_opt of a state over all 2^n, n = ``qubits``."""
    above = np.arange(1 << (qubits - selections.choices)) << selections.choices
    p = state.probability_of((selections.valid[:, None] + above).ravel())
    by_selection = p.reshape(len(selections.valid), len(above)).sum(axis=1)
    norm = state.norm()
    return float(by_selection.sum() / norm), float(by_selection[selections.optimal].sum() / norm)


def dense_qaoa_figures(
    model: QuboModel,
    start: Schedule,
    *,
    evaluations: int = 0,
    alpha: float = 1.0,
    threads: int | None = None,
) -> Figures:
    """P_feas and P_opt of plain QAOA with X mixer and all couplings.

    At 25 qubits and p = 2 an evaluation takes about a second on two cores that are free.

    Args:
        start: (β, γ) of each layer, for the normalised Hamiltonian.
        evaluations: of training on this instance, from there; 0: these angles as they are.
        alpha: of CVaR in training; 1: the mean.

    Raises:
        ValueError: more qubits than a state vector takes.
    """
    began = time.perf_counter()
    selections = valid_selections_of(model)
    ising = to_ising(model.total, model.variables).normalised()
    state = StateVector(cost_diagonal(ising), threads)
    schedule: Sequence[tuple[float, float]] = start
    used = 0
    if evaluations:
        training = train(state, start, Objective(alpha), evaluations=evaluations)
        schedule, used = training.schedule, training.evaluations
    else:
        state.evolve(start)
    qubits = len(model.variables)
    p_feasible, p_optimal = shares(state, selections, qubits)
    count = 1 << selections.choices
    return Figures(
        qubits=qubits,
        p_feasible=p_feasible,
        p_optimal=p_optimal,
        uniform_feasible=len(selections.valid) / count,
        uniform_optimal=int(selections.optimal.sum()) / count,
        schedule=tuple((float(beta), float(gamma)) for beta, gamma in schedule),
        evaluations=used,
        wall_s=time.perf_counter() - began,
    )

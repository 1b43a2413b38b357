"""Exact probabilities of valid and optimal selections in a simulated QAOA state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms import QuboModel
from dispatcher_daemon.solvers.quantum import to_ising
from dispatcher_daemon.solvers.quantum.statevector import (
    ExactState,
    Schedule,
    StateVector,
    cost_diagonal,
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
        p_feasible, p_optimal: probability of a valid, of an optimal selection, as drawn.
        uniform_feasible, uniform_optimal: the same of uniformly random bits.
    """

    p_feasible: float
    p_optimal: float
    uniform_feasible: float
    uniform_optimal: float


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


def dense_qaoa_figures(model: QuboModel, schedule: Schedule) -> Figures:
    """P_feas and P_opt of plain QAOA with X mixer and all couplings.

    Args:
        schedule: (β, γ) of each layer, for the normalised Hamiltonian.

    Raises:
        ValueError: more qubits than a state vector takes.
    """
    selections = valid_selections_of(model)
    ising = to_ising(model.total, model.variables).normalised()
    state = StateVector(cost_diagonal(ising))
    state.evolve(schedule)
    p_feasible, p_optimal = shares(state, selections, len(model.variables))
    count = 1 << selections.choices
    return Figures(
        p_feasible=p_feasible,
        p_optimal=p_optimal,
        uniform_feasible=len(selections.valid) / count,
        uniform_optimal=int(selections.optimal.sum()) / count,
    )

"""Training of dense QAOA on its exactly simulated state, and CVaR as what it lowers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from dispatcher_daemon.forms import Encoding
from dispatcher_daemon.settings import QaoaSettings
from dispatcher_daemon.solvers.quantum import QaoaSolver
from dispatcher_daemon.solvers.quantum.chain import train_schedule
from dispatcher_daemon.solvers.quantum.statevector import ExactState, Schedule
from slipstream.config import Settings


class QaoaOptions(Settings):
    """Dense QAOA as commands and benchmarks ask for it; None of iterations: untrained."""

    variant: str = "x"
    layers: int = Field(default=2, ge=1, le=20)
    shots: int = Field(default=4096, ge=1, le=1_000_000)
    iterations: int | None = Field(default=None, ge=1, le=100_000)


class QaoaAsked(Settings):
    """`QaoaOptions` as a section, so that faults name the solver."""

    qaoa: QaoaOptions


def make_qaoa(
    options: QaoaOptions, gamma: float | None = None, encoding: Encoding = "reduced"
) -> QaoaSolver:
    """The solver, with all 2p angles trained for the mean energy where iterations are asked for."""
    most = options.iterations

    def trained(state: ExactState, start: Schedule, deadline: float) -> None:
        train(state, start, evaluations=most or 1, deadline=deadline)

    return QaoaSolver(
        QaoaSettings.model_validate({"variant": options.variant}),
        options.layers,
        options.shots,
        gamma,
        encoding,
        None if most is None else trained,
    )


def train(
    state: ExactState,
    start: Schedule,
    alpha: float = 1.0,
    *,
    evaluations: int = 100,
    deadline: float = float("inf"),
) -> tuple[Sequence[tuple[float, float]], int]:
    """Lower the mean energy, or CVaR, by COBYLA: the best angles, and evaluations made.

    Args:
        state: is left at the angles found.
        alpha: share of the probability, lowest energies first; 1: the mean.
        evaluations: at most.
        deadline: `time.perf_counter` after which no evaluation begins but the first.
    """

    def value(schedule: Schedule) -> float:
        state.evolve(schedule)
        return state.mean() if alpha == 1 else cvar(state, alpha)

    found = train_schedule(list, value, start, evaluations=evaluations, deadline=deadline)
    state.evolve(found.circuit)
    return found.circuit, found.evaluations


def cvar(state: ExactState, alpha: float) -> float:
    """Mean energy of the lowest-energy share α of the probability, 0 < α ≤ 1."""
    order = np.argsort(state.diagonal, kind="stable")
    p = state.probabilities(0, len(order)).astype(np.float64)[order]
    reached = np.cumsum(p)
    wanted = alpha * reached[-1]
    taken = np.clip(wanted - (reached - p), 0.0, p)
    return float(taken @ state.diagonal[order] / wanted)

"""Training of a schedule on an exactly simulated state: few angles, few evaluations, a deadline."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.solvers.quantum.ansatz import linear_ramp
from dispatcher_daemon.solvers.quantum.statevector.exact_state import ExactState, Schedule

Angles = Literal["free", "ramp"]
"""What is trained: all 2p angles, or the heights Δβ and Δγ of a linear ramp."""

_STEP_RAD = 0.1


@dataclass(frozen=True)
class Objective:
    """Mean energy, or CVaR: that of the lowest share alpha of the probability."""

    alpha: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.alpha <= 1:
            raise ValueError(f"alpha must be in (0, 1]: {self.alpha}")

    def __call__(self, state: ExactState) -> float:
        """Value of a state."""
        return state.cvar(self.alpha)


@dataclass(frozen=True)
class Training:
    """Angles and how they were found.

    Attributes:
        schedule: (β, γ) of each layer: the best ones evaluated.
        value: their objective.
        history: objective of each evaluation, in turn.
        train_s: time taken.
        ended: why no more evaluations were made.
    """

    schedule: tuple[tuple[float, float], ...]
    value: float
    history: tuple[float, ...]
    train_s: float
    ended: Literal["converged", "evaluations", "deadline"]

    @property
    def evaluations(self) -> int:
        """Number of states that were simulated."""
        return len(self.history)


def train(
    state: ExactState,
    start: Schedule,
    objective: Objective | None = None,
    *,
    evaluations: int = 100,
    angles: Angles = "free",
    deadline: float = float("inf"),
) -> Training:
    """Lower the objective by COBYLA.

    Args:
        state: is left at the angles found.
        start: the first angles evaluated; their ramp heights, if only these are trained, are taken
            from the first β and the last γ.
        objective: None: the mean.
        evaluations: maximum number, at least 1.
        deadline: `time.perf_counter` by which it is to end: no evaluation is begun that would,
            going by the longest so far, end later. The first one always is.
    """
    from scipy.optimize import minimize

    began = time.perf_counter()
    objective = objective or Objective()
    layers = len(start)
    history: list[float] = []
    best: tuple[float, Schedule] = (float("inf"), start)
    longest_s = 0.0

    def evaluate(x: npt.NDArray[np.float64]) -> float:
        nonlocal best, longest_s
        now = time.perf_counter()
        if len(history) >= evaluations:
            raise _StopTraining("evaluations")
        # Twice: the state is simulated once more for the best angles.
        if history and now + 2 * longest_s > deadline:
            raise _StopTraining("deadline")
        schedule = unpack(x)
        state.evolve(schedule)
        value = objective(state)
        history.append(value)
        if value < best[0]:
            best = (value, schedule)
        longest_s = max(longest_s, time.perf_counter() - now)
        return value

    unpack: Callable[[npt.NDArray[np.float64]], Schedule]
    if angles == "ramp":
        x0 = np.array([start[0][0], start[-1][1]])

        def unpack(x: npt.NDArray[np.float64]) -> Schedule:
            return linear_ramp(layers, float(x[0]), float(x[1]))
    else:
        x0 = np.array(start, dtype=float).ravel()

        def unpack(x: npt.NDArray[np.float64]) -> Schedule:
            return [(float(beta), float(gamma)) for beta, gamma in x.reshape(-1, 2)]

    ended: Literal["converged", "evaluations", "deadline"] = "converged"
    try:
        # SciPy wants to be allowed a first simplex; `evaluate` keeps the count.
        options = {"rhobeg": _STEP_RAD, "maxiter": max(evaluations, len(x0) + 2)}
        minimize(evaluate, x0, method="COBYLA", options=options)
    except _StopTraining as end:
        ended = end.reason
    value, schedule = best
    if history[-1] != value:
        state.evolve(schedule)
    angles_found = tuple((float(beta), float(gamma)) for beta, gamma in schedule)
    return Training(angles_found, value, tuple(history), time.perf_counter() - began, ended)


class _StopTraining(Exception):
    def __init__(self, reason: Literal["evaluations", "deadline"]) -> None:
        super().__init__(reason)
        self.reason = reason

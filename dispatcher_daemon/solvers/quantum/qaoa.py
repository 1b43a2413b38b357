"""QAOA simulated exactly: all couplings, no noise, angles trained on the state itself.

A circuit of this kind fits no device's connections, so none is built here: depth and gates of the
dense circuit on a target come from `quantum.targets`, and `Execution` leaves them out.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import psutil

from dispatcher_daemon.forms import Encoding, Problem, QuboModel, RouteProblem, build_model
from dispatcher_daemon.settings import QaoaSettings
from dispatcher_daemon.solvers.protocol import Execution, Outcome
from dispatcher_daemon.solvers.quantum.ansatz import linear_ramp
from dispatcher_daemon.solvers.quantum.ising import to_ising
from dispatcher_daemon.solvers.quantum.statevector.diagonal import (
    MAX_ONE_HOT_STATES,
    MAX_QUBITS,
    cost_diagonal,
    one_hot_diagonal,
    standardised,
)
from dispatcher_daemon.solvers.quantum.statevector.exact_state import ExactState, Schedule
from dispatcher_daemon.solvers.quantum.statevector.subspace import OneHotState, one_hot_states
from dispatcher_daemon.solvers.quantum.statevector.transverse import StateVector, memory_bytes
from dispatcher_daemon.solvers.sampling import answer

_S_PER_STATE = {"x": (2e-8, 2e-8), "xy": (2e-6, 1e-6)}
"""Upper estimates on two cores, s a state: energy and sampling, and one layer. On a busy machine
training ends by its own deadline, or by the worker's."""
_POST_PROCESSING_SHARE = 0.25
_TRAINING_SHARE = 0.6


class UnsupportedProblemError(ValueError):
    """A problem that cannot be simulated in the time, in the memory, or at all."""


@dataclass(frozen=True)
class QaoaSolver:
    """QAOA on an exact state: X mixer on all 2^n states, or XY mixer on one-hot ones.

    Up to 27 qubits with the X mixer; with the XY mixer as many as there are route options, up to
    2^20 choices of one for each vehicle. Larger problems are refused before anything is computed.

    Attributes:
        layers: depth p.
        shots: number of samples.
        gamma, encoding: of the QUBO, see `build_model`.
        train: finds better angles from these on and leaves the state at them, by a time of
            `time.perf_counter`; None: the angles of `ramp_of` as they are.
    """

    settings: QaoaSettings = field(default_factory=QaoaSettings)
    layers: int = 2
    shots: int = 4096
    gamma: float | None = None
    encoding: Encoding = "reduced"
    train: Callable[[ExactState, Schedule, float], None] | None = None
    name: str = "qaoa"

    def warm_up(self) -> None:
        """Import what it needs."""
        import dwave.samplers  # noqa: F401
        import scipy.optimize  # noqa: F401

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`."""
        began = time.perf_counter()
        model = build_model(problem, self.gamma, encoding=self.encoding)
        try:
            self._check(model, deadline_s)
        except UnsupportedProblemError as error:
            wall_s = time.perf_counter() - began
            return Outcome(self.name, "failed", None, wall_s, reason=str(error))
        ising = to_ising(model.total, model.variables)
        state: ExactState
        if self.settings.variant == "xy":
            groups = _groups(model)
            diagonal = standardised(one_hot_diagonal(ising, groups))
            state = OneHotState(diagonal, groups)
        else:
            state = StateVector(cost_diagonal(ising.normalised()))
        start = ramp_of(self.settings.variant, self.layers)
        if self.train is None:
            state.evolve(start)
        else:
            self.train(state, start, began + _TRAINING_SHARE * deadline_s)
        trained = time.perf_counter()
        states, counts = state.sample(self.shots, seed)
        execution = Execution(
            backend="statevector",
            kind="simulated",
            variant=self.settings.variant,
            layers=self.layers,
            two_qubit_depth=None,
            two_qubit_gates=None,
            train_s=trained - began,
            sample_s=time.perf_counter() - trained,
        )
        return answer(
            self.name,
            model,
            state.bits(states),
            counts,
            seed,
            began,
            qubits=len(model.variables),
            execution=execution,
        )

    def _check(self, model: QuboModel, deadline_s: float) -> None:
        """Refuse what will not fit.

        Raises:
            UnsupportedProblemError: with the reason.
        """
        qubits = len(model.variables)
        if not qubits:
            raise UnsupportedProblemError("the problem has nothing to choose")
        if self.settings.variant == "xy":
            count = one_hot_states(_groups(model))
            if count == 0:
                raise UnsupportedProblemError("a vehicle has no option")
            if count > MAX_ONE_HOT_STATES:
                raise UnsupportedProblemError(
                    f"{count} combinations of options, the most is {MAX_ONE_HOT_STATES}"
                )
        else:
            if qubits > MAX_QUBITS:
                raise UnsupportedProblemError(
                    f"{qubits} qubits, the most for a state vector is {MAX_QUBITS}"
                )
            count = 1 << qubits
            needed, free = memory_bytes(qubits), psutil.virtual_memory().available
            if needed > free:
                raise UnsupportedProblemError(
                    f"{qubits} qubits need {needed >> 20} MiB of memory, {free >> 20} MiB are free"
                )
        once_s, layer_s = _S_PER_STATE[self.settings.variant]
        least_s = count * (once_s + self.layers * layer_s)
        if least_s > (1 - _POST_PROCESSING_SHARE) * deadline_s:
            raise UnsupportedProblemError(
                f"{qubits} qubits at p = {self.layers} take about {least_s:.1f} s untrained, "
                f"too much of {deadline_s:g} s"
            )


def ramp_of(variant: str, layers: int) -> Schedule:
    """The angles of a linear ramp, as transferred from other instances.

    Fits to ramps trained for CVaR 0.1, medians at p = 1, 2 and 3. X mixer, on the six published
    instances of 14 to 20 variables: Δβ = 0.38, 0.41, 0.44 and Δγ = 0.83, 1.21, 1.49. XY mixer, on
    random blocks of 5 · 5 options: 0.43, 0.56, 0.59 and 1.17, 1.41, 1.50.
    """
    if variant == "xy":
        return linear_ramp(layers, 0.45 * layers**0.27, 1.2 * layers**0.2)
    return linear_ramp(layers, 0.41, 0.83 * layers**0.5)


def _groups(model: QuboModel) -> list[tuple[int, ...]]:
    """Qubits of each vehicle's options.

    Raises:
        UnsupportedProblemError: the problem is not in route form.
    """
    if not isinstance(model.problem, RouteProblem):
        raise UnsupportedProblemError(
            "the XY mixer needs route options: the arc form has no one-hot groups"
        )
    return list(model.problem.options_of.values())

"""The protocol of all solvers, and what they answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from dispatcher_daemon.problem import Problem
from dispatcher_daemon.solvers.distribution import BitDistribution

Status = Literal["optimal", "feasible", "infeasible", "timeout", "failed"]


Tally = tuple[tuple[float, int], ...]
"""Shots by objective value, kWh, rising: of samples that decode to valid routes."""


@dataclass(frozen=True)
class Samples:
    """Statistics of a sampling solver, stage by stage and never mixed.

    Attributes:
        qubits: width of the circuit; None from a classical sampler.
        shots: number of samples.
        raw: as drawn.
        descended: each sample after one-flip steepest descent on the full QUBO.
        repaired: route form: one option for each vehicle, then that descent; arc form: routes that
            follow the arcs of the descended sample where these lead to valid ones.
    """

    qubits: int | None
    shots: int
    raw: Tally
    descended: Tally
    repaired: Tally

    def share(self, which: Tally, best_kwh: float | None = None) -> float:
        """Share of the shots that are in a stage's tally, or there with the best objective."""
        hits = sum(n for value, n in which if best_kwh is None or value <= best_kwh + 1e-9)
        return hits / self.shots


BackendKind = Literal["simulated", "noise-model", "hardware"]


@dataclass(frozen=True)
class Execution:
    """How the circuit behind an answer was trained and where it ran.

    Attributes:
        backend: where, as named to `slipstream solve --backend`.
        kind: a simulation without noise, one with a device's noise model, or a device.
        variant: of the algorithm.
        layers: depth p; 0 where the algorithm has none.
        two_qubit_depth: layers of two-qubit gates of the circuit as it ran (transpiled); None
            where the service does not tell.
        two_qubit_gates: their number.
        train_s: time for the angles, s.
        sample_s: time from handing the circuit over to its samples, s.
        fallback: why it is not the backend that was asked for; None if it is.
        job: the service's id of the job.
    """

    backend: str
    kind: BackendKind
    variant: str
    layers: int
    two_qubit_depth: int | None
    two_qubit_gates: int | None
    train_s: float
    sample_s: float
    fallback: str | None = None
    job: str | None = None


@dataclass(frozen=True)
class Outcome:
    """What a solver answers; the dispatcher re-evaluates and verifies all of it.

    Attributes:
        solver: its name.
        status: "optimal" only from an exact solver that proved it.
        selected: indices of the chosen arcs or options; None without an answer.
        wall_s: time from the request to the answer.
        repaired: True if the answer only came out of post-processing.
        samples: statistics of a sampling solver.
        reason: why there is no answer.
        execution: of a quantum circuit; None from a classical solver.
        controls: by name, what the circuit began with or was trained around, as a distribution
            that needs no circuit; in the order of the QUBO's variables.
    """

    solver: str
    status: Status
    selected: frozenset[int] | None
    wall_s: float
    repaired: bool = False
    samples: Samples | None = None
    reason: str | None = None
    execution: Execution | None = None
    controls: tuple[tuple[str, BitDistribution], ...] = ()


class Solver(Protocol):
    """A solver of arc and route problems; picklable, as it runs in a worker process."""

    @property
    def name(self) -> str:
        """Its name in settings, reports and on the dashboard."""
        ...

    def warm_up(self) -> None:
        """Import what it needs, so that no cycle pays for it."""
        ...

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """Solve within the deadline; the worker is killed a little after it.

        Args:
            problem: in arc or route form.
            deadline_s: time to answer in, s.
            seed: of everything random in it.
        """
        ...

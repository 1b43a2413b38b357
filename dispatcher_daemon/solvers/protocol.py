"""The protocol of all solvers, and their outcomes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

if TYPE_CHECKING:
    from dispatcher_daemon.forms import Problem
    from dispatcher_daemon.solvers.distribution import BitDistribution

Status = Literal["optimal", "feasible", "infeasible", "timeout", "failed"]


Histogram = tuple[tuple[float, int], ...]
"""Shots by objective value, kWh, ascending, of samples that decode to valid routes."""


@dataclass(frozen=True)
class Samples:
    """Statistics of a sampling solver, separate for each stage.

    Attributes:
        qubits: width of the circuit; None from a classical sampler.
        shots: number of samples.
        raw: as drawn.
        descended: each sample after one-flip steepest descent on the full QUBO.
        repaired: route form: one option for each vehicle, then that descent; arc form: routes that
            follow the arcs of the descended sample where these lead to valid ones; a QUBO as
            such: the descended ones.
    """

    qubits: int | None
    shots: int
    raw: Histogram
    descended: Histogram
    repaired: Histogram

    def share(self, which: Histogram, best_kwh: float | None = None) -> float:
        """Share of the shots that are in a stage's histogram, or there with the best objective."""
        hits = sum(n for value, n in which if best_kwh is None or value <= best_kwh + 1e-9)
        return hits / self.shots


BackendKind = Literal["simulated", "noise-model", "hardware"]


@dataclass(frozen=True)
class Execution:
    """How the circuit behind an answer was trained and where it ran.

    Attributes:
        backend: its name, as in `slipstream solve --backend`.
        kind: a simulation without noise, one with a device's noise model, or a device.
        variant: of the algorithm.
        layers: depth p; 0 where the algorithm has none.
        two_qubit_depth: layers of two-qubit gates of the circuit as it ran (transpiled); None
            where the service does not report it.
        two_qubit_gates: their number.
        train_s: time for the angles, s.
        sample_s: time from handing the circuit over to its samples, s.
        fallback: why it is not the requested backend; None if it is.
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
    """A solver's answer; the dispatcher re-evaluates and verifies it.

    Attributes:
        solver: its name.
        status: "optimal" only from an exact solver that proved it.
        selected: indices of the chosen arcs or options; None without an answer.
        wall_s: time from the request to the answer.
        repaired: True if the answer only came out of post-processing.
        samples: statistics of a sampling solver.
        reason: why there is no answer.
        execution: of a quantum circuit; None from a classical solver.
        controls: by name, distributions that need no circuit, for comparison, such as the trained
            state's marginals; in the order of the QUBO's variables.
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
        """Import libraries, so that no cycle takes time for it."""
        ...

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """Solve within the deadline; the worker is killed a little after it.

        Args:
            problem: in arc or route form.
            deadline_s: time to answer in, s.
            seed: of everything random in it.
        """
        ...

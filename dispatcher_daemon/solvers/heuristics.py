"""Tabu search and simulated annealing on the QUBO, by dwave-samplers."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from dispatcher_daemon.formulations.model import Encoding, build_model
from dispatcher_daemon.problem import Problem
from dispatcher_daemon.solvers.base import Outcome
from dispatcher_daemon.solvers.sampling import Bits, answer, in_order

_SEARCH_SHARE = 0.7
"""Part of the deadline that the search may take; decoding and repair need the rest."""


@dataclass(frozen=True)
class TabuSolver:
    """Multistart tabu search.

    Its length is bounded by moves, not by time, so that a seed gives one answer wherever the
    deadline leaves enough time for them.

    Attributes:
        reads: searches, each from a random state; fewer if time is up.
        restarts: of each search.
        moves: most moves of the first search of a read by number of variables; a quarter of it
            after restarts.
        gamma: penalty weight of the QUBO, kWh; None: computed.
        encoding: of the arc form's subtour terms.
    """

    reads: int = 32
    restarts: int = 10
    moves: int = 500
    gamma: float | None = None
    encoding: Encoding = "reduced"
    name: str = "tabu"

    def warm_up(self) -> None:
        """Import the sampler."""
        import dwave.samplers  # noqa: F401

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`."""
        from dwave.samplers import TabuSampler

        began = time.perf_counter()
        model = build_model(problem, self.gamma, encoding=self.encoding)
        if not model.variables:
            return _without_variables(self.name, began)
        ends = began + _SEARCH_SHARE * deadline_s
        sampler: Any = TabuSampler
        found: list[Bits] = []
        # Read by read, as the sampler's own time limit is a coarse one.
        while len(found) < self.reads and (left_s := ends - time.perf_counter()) > 0:
            read = sampler().sample(
                model.total,
                num_restarts=self.restarts,
                coefficient_z_first=self.moves,
                lower_bound_z=1,
                timeout=max(1, int(1000 * left_s)),
                seed=(seed + len(found)) % 2**32,
            )
            found.append(in_order(model, read))
        if not found:
            return _no_time(self.name, began)
        bits = np.concatenate(found)
        return answer(self.name, model, bits, np.ones(len(bits), dtype=np.int64), seed, began)


@dataclass(frozen=True)
class AnnealingSolver:
    """Simulated annealing, temperatures chosen by the sampler from the model's biases.

    Attributes:
        reads: runs, each from a random state; fewer if time is up.
        sweeps: of each run.
        gamma: penalty weight of the QUBO, kWh; None: computed.
        encoding: of the arc form's subtour terms.
    """

    reads: int = 200
    sweeps: int = 1000
    gamma: float | None = None
    encoding: Encoding = "reduced"
    name: str = "annealing"

    def warm_up(self) -> None:
        """Import the sampler."""
        import dwave.samplers  # noqa: F401

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`."""
        from dwave.samplers import SimulatedAnnealingSampler

        began = time.perf_counter()
        model = build_model(problem, self.gamma, encoding=self.encoding)
        if not model.variables:
            return _without_variables(self.name, began)
        ends = began + _SEARCH_SHARE * deadline_s
        sampler: Any = SimulatedAnnealingSampler
        found = sampler().sample(
            model.total,
            num_reads=self.reads,
            num_sweeps=self.sweeps,
            interrupt_function=lambda: time.perf_counter() >= ends,
            seed=seed % 2**32,
        )
        counts = np.asarray(found.record.num_occurrences, dtype=np.int64)
        return answer(self.name, model, in_order(model, found), counts, seed, began)


def _without_variables(solver: str, began: float) -> Outcome:
    wall_s = time.perf_counter() - began
    return Outcome(solver, "failed", None, wall_s, reason="the problem has nothing to choose")


def _no_time(solver: str, began: float) -> Outcome:
    wall_s = time.perf_counter() - began
    return Outcome(solver, "timeout", None, wall_s, reason="no time left for a search")

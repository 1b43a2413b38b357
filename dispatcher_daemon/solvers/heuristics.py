"""Tabu search and simulated annealing on the QUBO, by dwave-samplers."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from dispatcher_daemon.forms import Encoding, Problem, QuboModel
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.sampling import Bits, SampledBits, in_order, solve_by_sampling

_SEARCH_SHARE = 0.7
"""Share of the deadline for the search; decoding and repair need the rest."""


@dataclass(frozen=True)
class TabuSolver:
    """Multistart tabu search.

    Its length is bounded by moves, not by time, so that a seed gives one answer wherever the
    deadline leaves enough time for them.

    Attributes:
        reads: searches, each from a random state; fewer if time is up.
        restarts: of each search.
        moves: maximum number of moves of the first search of a read, for each variable; a quarter
            of it after restarts.
        gamma, encoding: of the QUBO, see `build_model`.
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

        ends = time.perf_counter() + _SEARCH_SHARE * deadline_s
        sampler: Any = TabuSampler

        def draw(model: QuboModel) -> SampledBits | None:
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
                return None
            bits = np.concatenate(found)
            return SampledBits(bits, np.ones(len(bits), dtype=np.int64))

        return solve_by_sampling(self.name, problem, self.gamma, self.encoding, seed, draw)


@dataclass(frozen=True)
class AnnealingSolver:
    """Simulated annealing, temperatures chosen by the sampler from the model's biases.

    Attributes:
        reads: runs, each from a random state; fewer if time is up.
        sweeps: of each run.
        gamma, encoding: of the QUBO, see `build_model`.
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

        ends = time.perf_counter() + _SEARCH_SHARE * deadline_s
        sampler: Any = SimulatedAnnealingSampler

        def draw(model: QuboModel) -> SampledBits:
            found = sampler().sample(
                model.total,
                num_reads=self.reads,
                num_sweeps=self.sweeps,
                interrupt_function=lambda: time.perf_counter() >= ends,
                seed=seed % 2**32,
            )
            counts = np.asarray(found.record.num_occurrences, dtype=np.int64)
            return SampledBits(in_order(model, found), counts)

        return solve_by_sampling(self.name, problem, self.gamma, self.encoding, seed, draw)

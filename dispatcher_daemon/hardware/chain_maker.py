"""Circuits of LC-QAOA for a device: the solver's own, trained as for the simulator."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dispatcher_daemon.formulations.model import QuboModel
from dispatcher_daemon.hardware.making import Made, Unsuitable, fingerprint
from dispatcher_daemon.problem import Problem
from dispatcher_daemon.solvers.lc_qaoa import LcQaoaSolver, Place, VariantError, counts_to_bits
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from dispatcher_daemon.solvers.sampling import Drawn, solve_by_sampling


@dataclass(frozen=True)
class ChainMaker:
    """See `Maker`.

    Attributes:
        solver: whose circuits these are.
    """

    solver: LcQaoaSolver

    @property
    def name(self) -> str:
        """The solver's name."""
        return self.solver.name

    @property
    def dialect(self) -> str:
        """The encoding: variables beside the choices depend on it."""
        return self.solver.encoding

    def warm_up(self) -> None:
        """Import what training, building and scoring need."""
        zero = np.zeros((1, 2))
        self.circuit(ChainAnsatz(zero, np.ones((1, 1)), zero))
        import dwave.samplers  # noqa: F401
        import scipy.optimize  # noqa: F401

    def circuit(self, ansatz: Any) -> Any:
        """The measured circuit of an ansatz."""
        return circuit_of(ansatz)

    def make(
        self, problem: Problem, deadline_s: float, seed: int, place: Place | None = None
    ) -> Made:
        """See `Maker.make`."""
        if not problem.choices:
            raise Unsuitable("the problem has nothing to choose")
        try:
            prepared = self.solver.prepare(problem, deadline_s, seed, place)
        except VariantError as error:
            raise Unsuitable(str(error)) from None
        tables = [np.asarray(table).tolist() for table in vars(prepared.ansatz).values()]
        return Made(
            self.circuit(prepared.ansatz),
            prepared.order,
            fingerprint(prepared.order, *tables),
            prepared.variant,
            self.solver.settings.layers,
            prepared.train_s,
        )

    def read(
        self, problem: Problem, order: Sequence[int], samples: Mapping[str, int], seed: int
    ) -> Outcome:
        """See `Maker.read`; an outcome without an answer if the number of variables differs."""
        began = time.perf_counter()

        def draw(model: QuboModel) -> Drawn:
            if len(order) != len(model.variables):
                raise Unsuitable("the problem has another number of variables by now")
            bits, shots = counts_to_bits(samples, tuple(order))
            return Drawn(bits, shots, len(order))

        try:
            gamma, encoding = self.solver.gamma, self.solver.encoding
            return solve_by_sampling(self.name, problem, gamma, encoding, seed, draw)
        except Unsuitable as error:
            wall_s = time.perf_counter() - began
            return Outcome(self.name, "failed", None, wall_s, reason=str(error))

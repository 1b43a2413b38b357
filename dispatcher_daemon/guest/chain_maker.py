"""Circuits of LC-QAOA for a device: the solver's own, trained as for the simulator."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dispatcher_daemon.formulations.model import build_model
from dispatcher_daemon.guest.making import Made, fingerprint
from dispatcher_daemon.problem import Problem
from dispatcher_daemon.quantum.circuits import circuit_of
from dispatcher_daemon.quantum.jobs import ServiceFault
from dispatcher_daemon.solvers.base import Outcome
from dispatcher_daemon.solvers.lc_qaoa import LcQaoaSolver, counts_to_bits
from dispatcher_daemon.solvers.sampling import answer


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
        """Import what the solver does."""
        self.solver.warm_up()

    def circuit(self, ansatz: Any) -> Any:
        """The measured circuit of an ansatz."""
        return circuit_of(ansatz)

    def make(self, problem: Problem, deadline_s: float, seed: int) -> Made:
        """See `Maker.make`."""
        prepared = self.solver.prepare(problem, deadline_s, seed)
        return Made(
            self.circuit(prepared.ansatz),
            prepared.order,
            fingerprint(
                prepared.order,
                *(t.tolist() for t in vars(prepared.ansatz).values() if isinstance(t, np.ndarray)),
            ),
            prepared.variant,
            prepared.ansatz.layers,
            prepared.train_s,
        )

    def read(
        self, problem: Problem, order: Sequence[int], samples: Mapping[str, int], seed: int
    ) -> Outcome:
        """See `Maker.read`.

        Raises:
            ServiceFault: of kind "garbage": the problem has another number of variables.
        """
        began = time.perf_counter()
        model = build_model(problem, self.solver.gamma, encoding=self.solver.encoding)
        if len(order) != len(model.variables):
            raise ServiceFault("garbage", "the problem has another number of variables by now")
        bits, shots = counts_to_bits(samples, list(order))
        return answer(self.name, model, bits, shots, seed, began, qubits=len(order))

"""Linear-Chain QAOA on Aer: nearest-neighbour ZZ couplings, linear-ramp angles, one sampling job.

Samples are scored with the full QUBO, whatever the circuit left out of it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.formulations.model import Encoding, build_model
from dispatcher_daemon.problem import Problem
from dispatcher_daemon.quantum.ansatz import linear_ramp, scheduled
from dispatcher_daemon.quantum.chain_order import heavy_path
from dispatcher_daemon.quantum.circuits import circuit_of
from dispatcher_daemon.quantum.ising import Ising, to_ising
from dispatcher_daemon.solvers.base import Outcome
from dispatcher_daemon.solvers.sampling import Bits, answer


def sample_mps(circuit: Any, shots: int, seed: int) -> dict[str, int]:
    """Counts by Qiskit bit string (qubit 0 comes last), from Aer's matrix product state."""
    from qiskit_aer import AerSimulator

    # Aer drops a seed of 0.
    simulator = AerSimulator(
        method="matrix_product_state", seed_simulator=seed % 2**31 + 1, max_parallel_threads=1
    )
    counts: dict[str, int] = simulator.run(circuit, shots=shots).result().get_counts()
    return counts


def counts_to_bits(
    counts: Mapping[str, int], order: list[int]
) -> tuple[Bits, npt.NDArray[np.int64]]:
    """Samples as rows of bits by variable, and their counts, in the order of the bit strings.

    Args:
        order: qubit q carries variable ``order[q]``.
    """
    strings = sorted(counts)
    by_qubit = np.array([[int(c) for c in reversed(s)] for s in strings], dtype=np.int8)
    bits = np.empty_like(by_qubit)
    bits[:, order] = by_qubit
    return bits, np.array([counts[s] for s in strings], dtype=np.int64)


@dataclass(frozen=True)
class LcQaoaSolver:
    """LC-QAOA without training: angles come from the ramp.

    Attributes:
        layers: p.
        shots: samples drawn.
        delta_beta: height of the mixer ramp, rad.
        delta_gamma: height of the phase ramp, rad.
        gamma: penalty weight of the QUBO, kWh; None: computed.
        encoding: of the arc form's subtour terms.
    """

    layers: int = 2
    shots: int = 4096
    delta_beta: float = 0.3
    delta_gamma: float = 0.6
    gamma: float | None = None
    encoding: Encoding = "reduced"
    name: str = "lc-qaoa"

    def warm_up(self) -> None:
        """Import Qiskit and Aer and run a circuit, as the first run loads their compiled parts."""
        model = Ising(np.array([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]]), 0.0)
        sample_mps(circuit_of(scheduled(model, [(0.1, 0.1)])), 16, 1)
        import dwave.samplers  # noqa: F401

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`; the deadline is left to the worker, as no step can be cut short."""
        began = time.perf_counter()
        model = build_model(problem, self.gamma, encoding=self.encoding)
        ising = to_ising(model.total, model.variables)
        order = heavy_path(ising.coupling)
        angles = linear_ramp(self.layers, self.delta_beta, self.delta_gamma)
        circuit = circuit_of(scheduled(ising.permuted(order).normalised(), angles))
        bits, shots = counts_to_bits(sample_mps(circuit, self.shots, seed), order)
        return answer(self.name, model, bits, shots, seed, began, qubits=len(model.variables))

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
from dispatcher_daemon.solvers.base import Outcome
from dispatcher_daemon.solvers.chain import heavy_path
from dispatcher_daemon.solvers.ising import Ising, to_ising
from dispatcher_daemon.solvers.sampling import Bits, answer


def linear_ramp(layers: int, delta_beta: float, delta_gamma: float) -> list[tuple[float, float]]:
    """(β_i, γ_i) with β_i = (1 − i/p) Δβ and γ_i = ((i + 1)/p) Δγ, i = 0..p − 1 (LR-QAOA)."""
    return [
        ((1 - i / layers) * delta_beta, ((i + 1) / layers) * delta_gamma) for i in range(layers)
    ]


def chain_circuit(ising: Ising, angles: list[tuple[float, float]]) -> Any:
    """QAOA circuit whose phase layers hold all fields and the couplings of neighbours only.

    Layer: e^{−iγ C_chain}, the ZZ terms as two commuting brick layers, then e^{+iβ ΣX}. That sign
    goes with the ramp: the start |+⟩^n is the ground state of −ΣX, and C is to be minimised.

    Args:
        ising: normalised, in chain order.
        angles: (β, γ) of each layer.

    Returns:
        A measured `qiskit.QuantumCircuit`; classical bit q is qubit q.
    """
    from qiskit import QuantumCircuit

    n = len(ising.h)
    circuit = QuantumCircuit(n, n)
    circuit.h(range(n))
    for beta, gamma in angles:
        for qubit in range(n):
            circuit.rz(2 * gamma * ising.h[qubit], qubit)
        for first in (0, 1):
            for qubit in range(first, n - 1, 2):
                coupling = ising.coupling[qubit, qubit + 1]
                if coupling != 0:
                    circuit.rzz(2 * gamma * coupling, qubit, qubit + 1)
        for qubit in range(n):
            circuit.rx(-2 * beta, qubit)
    circuit.measure(range(n), range(n))
    return circuit


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
        sample_mps(chain_circuit(model, [(0.1, 0.1)]), 16, 1)
        import dwave.samplers  # noqa: F401

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`; the deadline is left to the worker, as no step can be cut short."""
        began = time.perf_counter()
        model = build_model(problem, self.gamma, encoding=self.encoding)
        ising = to_ising(model.total, model.variables)
        order = heavy_path(ising.coupling)
        angles = linear_ramp(self.layers, self.delta_beta, self.delta_gamma)
        circuit = chain_circuit(ising.permuted(order).normalised(), angles)
        bits, shots = counts_to_bits(sample_mps(circuit, self.shots, seed), order)
        return answer(self.name, model, bits, shots, seed, began, qubits=len(model.variables))

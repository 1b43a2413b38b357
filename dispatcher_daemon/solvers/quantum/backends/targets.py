"""Circuits for a device: transpiled, counted, and compared with the dense circuit."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dispatcher_daemon.solvers.quantum.ansatz import scheduled
from dispatcher_daemon.solvers.quantum.chain.layout import place_chain
from dispatcher_daemon.solvers.quantum.circuits import (
    circuit_of,
    dense_qaoa_circuit,
    swap_network_circuit,
)
from dispatcher_daemon.solvers.quantum.ising import Ising

SEED = 1
"""Of the transpiler's random choices; a chain leaves it none."""


def transpile_on(circuit: Any, target: Any, qubits: Sequence[int]) -> Any:
    """A chain circuit in the target's gates, qubit q on physical qubit ``qubits[q]``.

    Angles of native RZZ gates are folded into 0..π/2, the range of IBM's fractional gates; local
    gates make up for it exactly.

    Raises:
        ValueError: two-qubit gates between qubits without an edge: the chain's cuts.
    """
    from qiskit.transpiler import PassManager, generate_preset_pass_manager
    from qiskit.transpiler.passes import Optimize1qGatesDecomposition

    edges = {frozenset(pair) for pair in target.build_coupling_map().get_edges()}
    for instruction in circuit.data:
        pair = [circuit.find_bit(q).index for q in instruction.qubits]
        if len(pair) == 2 and frozenset(qubits[q] for q in pair) not in edges:
            raise ValueError(f"no edge for the {instruction.operation.name} on qubits {pair}")
    passes = generate_preset_pass_manager(
        optimization_level=1, target=target, initial_layout=list(qubits), seed_transpiler=SEED
    )
    transpiled = passes.run(circuit)
    if "rzz" in target.operation_names:
        from qiskit_ibm_runtime.transpiler.passes import FoldRzzAngle

        fold = PassManager([FoldRzzAngle(), Optimize1qGatesDecomposition(target=target)])
        transpiled = fold.run(transpiled)
    return transpiled


def transpile_dense(circuit: Any, target: Any) -> Any:
    """A circuit without a chain's shape, as well as the transpiler's highest level can."""
    from qiskit.transpiler import generate_preset_pass_manager

    passes = generate_preset_pass_manager(optimization_level=3, target=target, seed_transpiler=SEED)
    return passes.run(circuit)


def two_qubit_depth(circuit: Any) -> int:
    """Layers of two-qubit gates on the longest way through a circuit."""
    return int(circuit.depth(_is_two_qubit_gate))


def two_qubit_gates(circuit: Any) -> int:
    """Number of two-qubit gates."""
    return sum(map(_is_two_qubit_gate, circuit.data))


def with_fractional_gates(target: Any) -> Any:
    """A copy of a target with RZZ on every CZ edge and RX on every qubit.

    Snapshots of devices list no fractional gates. ASSUMPTION: an RZZ has the error and duration of
    the edge's CZ, an RX those of the qubit's SX; devices report values of their own.
    """
    from qiskit.circuit import Parameter
    from qiskit.circuit.library import RXGate, RZZGate

    fractional = copy.deepcopy(target)
    if "rzz" not in fractional.operation_names:
        fractional.add_instruction(RZZGate(Parameter("θ")), dict(target["cz"]))
    if "rx" not in fractional.operation_names:
        fractional.add_instruction(RXGate(Parameter("θ")), dict(target["sx"]))
    return fractional


@dataclass(frozen=True)
class Depths:
    """What one instance's circuits need on a target, transpiled in one run.

    Attributes:
        chain_depth: two-qubit depth of LC-QAOA.
        chain_gates: its two-qubit gates.
        dense_depth: two-qubit depth of QAOA with all couplings, by the better method.
        dense_gates: two-qubit gates of that circuit.
        dense_method: "routed" by the transpiler, or "swap network" on the best chain.
    """

    chain_depth: int
    chain_gates: int
    dense_depth: int
    dense_gates: int
    dense_method: str

    @property
    def reduction(self) -> float:
        """Share of the dense circuit's depth that the chain saves."""
        return 1 - self.chain_depth / self.dense_depth


def compare_depths(ising: Ising, schedule: Sequence[tuple[float, float]], target: Any) -> Depths:
    """LC-QAOA beside dense QAOA on one target; the latter by the shallower of two methods.

    Args:
        ising: in chain order, normalised.
        schedule: (β, γ) of each layer.
        target: `qiskit.transpiler.Target`.
    """
    qubits = place_chain(target, len(ising.h), len(schedule)).qubits
    chain = transpile_on(circuit_of(scheduled(ising, schedule)), target, qubits)
    candidates = {
        "routed": transpile_dense(dense_qaoa_circuit(ising, schedule), target),
        "swap network": transpile_on(swap_network_circuit(ising, schedule), target, qubits),
    }
    method, dense = min(candidates.items(), key=lambda item: two_qubit_depth(item[1]))
    return Depths(
        chain_depth=two_qubit_depth(chain),
        chain_gates=two_qubit_gates(chain),
        dense_depth=two_qubit_depth(dense),
        dense_gates=two_qubit_gates(dense),
        dense_method=method,
    )


def _is_two_qubit_gate(instruction: Any) -> bool:
    return len(instruction.qubits) == 2 and instruction.operation.name not in {"barrier", "delay"}

"""Circuits for a device: transpiled and counted."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

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


def _is_two_qubit_gate(instruction: Any) -> bool:
    return len(instruction.qubits) == 2 and instruction.operation.name not in {"barrier", "delay"}

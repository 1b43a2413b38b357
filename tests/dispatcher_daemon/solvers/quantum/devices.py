"""Small devices with errors of choice, and what circuits do on them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from qiskit import QuantumCircuit
from qiskit.circuit import Parameter
from qiskit.circuit.library import CZGate, Measure, RZGate, SXGate, XGate
from qiskit.quantum_info import Statevector
from qiskit.transpiler import InstructionProperties, QubitProperties, Target

from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz, OneHotAnsatz
from dispatcher_daemon.solvers.quantum.backends.trajectories import measured_qubits


def make_target(
    edges: Mapping[tuple[int, int], float],
    *,
    gate: float | Mapping[int, float] = 1e-4,
    readout: float | Mapping[int, float] = 0.01,
    t1_s: float = 2e-4,
    t2_s: float = 3e-4,
) -> Target:
    """A device of CZ, RZ, SX and X gates with these errors on its edges."""
    n = 1 + max(q for pair in edges for q in pair)

    def single(error: float | Mapping[int, float], duration_s: float) -> dict[Any, Any]:
        values = dict.fromkeys(range(n), error) if not isinstance(error, Mapping) else error
        return {(q,): InstructionProperties(duration_s, values[q]) for q in range(n)}

    target = Target(num_qubits=n, qubit_properties=[QubitProperties(t1_s, t2_s)] * n)
    target.add_instruction(
        CZGate(),
        {
            pair: InstructionProperties(7e-8, error)
            for (a, b), error in edges.items()
            for pair in ((a, b), (b, a))
        },
    )
    target.add_instruction(RZGate(Parameter("a")), single(0.0, 0.0))
    target.add_instruction(SXGate(), single(gate, 3e-8))
    target.add_instruction(XGate(), single(gate, 3e-8))
    target.add_instruction(Measure(), single(readout, 1e-6))
    return target


def line(n: int, error: float = 1e-3) -> dict[tuple[int, int], float]:
    """Edges of a row of qubits."""
    return {(q, q + 1): error for q in range(n - 1)}


def random_chain(n: int, layers: int, seed: int, widest: float = 7.0) -> ChainAnsatz:
    """Angles of any size and sign."""
    rng = np.random.default_rng(seed)
    return ChainAnsatz(
        fields=rng.uniform(-widest, widest, (layers, n)),
        bonds=rng.uniform(-widest, widest, (layers, n - 1)),
        mixers=rng.uniform(-widest, widest, (layers, n)),
    )


def random_one_hot(groups: tuple[int, ...], layers: int, seed: int) -> OneHotAnsatz:
    """Angles of any size and sign; hot qubits anywhere in their groups."""
    rng = np.random.default_rng(seed)
    n, starts = sum(groups), np.cumsum((0, *groups[:-1]))
    inside = np.ones(n - 1)
    inside[starts[1:] - 1] = 0
    return OneHotAnsatz(
        groups=groups,
        hot=tuple(int(s + rng.integers(size)) for s, size in zip(starts, groups, strict=True)),
        spread=rng.uniform(-4, 4, n - 1) * inside,
        fields=rng.uniform(-4, 4, (layers, n)),
        bonds=rng.uniform(-7, 7, (layers, len(groups) - 1)),
        mixers=rng.uniform(-4, 4, (layers, n - 1)) * inside,
    )


def probabilities(circuit: Any) -> np.ndarray:
    """Of the classical bits (bit 0 least significant), from the gates alone, without noise."""
    measured = measured_qubits(circuit)
    used = list(measured)
    for instruction in circuit.data:
        if instruction.operation.name != "barrier":
            used += [circuit.find_bit(q).index for q in instruction.qubits]
    place = {qubit: i for i, qubit in enumerate(dict.fromkeys(used))}
    small = QuantumCircuit(len(place))
    for instruction in circuit.data:
        if instruction.operation.name not in {"barrier", "measure"}:
            qubits = [place[circuit.find_bit(q).index] for q in instruction.qubits]
            small.append(instruction.operation, qubits)
    return np.asarray(Statevector(small).probabilities(range(len(measured))))


def frequencies(counts: Mapping[str, int]) -> np.ndarray:
    """Of the classical bits, from counts by bit string."""
    n = len(next(iter(counts)))
    found = np.zeros(2**n)
    for text, count in counts.items():
        found[int(text, 2)] += count
    return found / found.sum()


def names(circuit: Any) -> Iterable[str]:
    """Names of a circuit's gates."""
    return (instruction.operation.name for instruction in circuit.data)

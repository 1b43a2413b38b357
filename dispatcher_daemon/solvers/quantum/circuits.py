"""Ansätze as Qiskit circuits; classical bit q is the chain's qubit q."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz, OneHotAnsatz
from dispatcher_daemon.solvers.quantum.ising import Ising


def circuit_of(ansatz: ChainAnsatz | OneHotAnsatz) -> Any:
    """The measured `qiskit.QuantumCircuit` of an ansatz."""
    return one_hot_circuit(ansatz) if isinstance(ansatz, OneHotAnsatz) else chain_circuit(ansatz)


def chain_circuit(ansatz: ChainAnsatz) -> Any:
    """The measured `qiskit.QuantumCircuit` of a chain ansatz."""
    n = ansatz.width
    circuit = _empty(n)
    circuit.h(range(n))
    for fields, bonds, mixers in zip(ansatz.fields, ansatz.bonds, ansatz.mixers, strict=True):
        _fields(circuit, fields)
        for first in (0, 1):
            for qubit in range(first, n - 1, 2):
                if bonds[qubit] != 0:
                    circuit.rzz(bonds[qubit], qubit, qubit + 1)
        for qubit in range(n):
            if mixers[qubit] != 0:
                circuit.rx(mixers[qubit], qubit)
    circuit.measure(range(n), range(n))
    return circuit


def one_hot_circuit(ansatz: OneHotAnsatz) -> Any:
    """The measured `qiskit.QuantumCircuit` of a one-hot ansatz."""
    n = ansatz.width
    circuit = _empty(n)
    circuit.x(ansatz.hot)
    for qubit in spread_order(ansatz):
        _xy_gate(circuit, ansatz.spread[qubit], qubit)
    starts = _starts(ansatz)
    for fields, bonds, mixers in zip(ansatz.fields, ansatz.bonds, ansatz.mixers, strict=True):
        _fields(circuit, fields)
        for start, bond in zip(starts[1:], bonds, strict=True):
            if bond != 0:
                circuit.rzz(bond, start - 1, start)
        for first in (0, 1):
            for qubit in range(first, n - 1, 2):
                _xy_gate(circuit, mixers[qubit], qubit)
    circuit.measure(range(n), range(n))
    return circuit


def spread_order(ansatz: OneHotAnsatz) -> list[int]:
    """Pairs (q, q + 1), by q, in the order in which the start of a one-hot ansatz applies them.

    Group by group; inside a group by growing distance from the hot qubit, the upper side first.
    """
    order = []
    for size, start, hot in zip(ansatz.groups, _starts(ansatz), ansatz.hot, strict=True):
        for distance in range(size - 1):
            if hot + distance + 1 < start + size:
                order.append(hot + distance)
            if hot - distance - 1 >= start:
                order.append(hot - distance - 1)
    return order


def dense_qaoa_circuit(ising: Ising, schedule: Sequence[tuple[float, float]]) -> Any:
    """QAOA with all couplings, measured, for comparison with the chain.

    Each layer is e^{−iγC}, then e^{+iβΣX}.

    Args:
        ising: normalised; couplings of 0 get no gate.
        schedule: (β, γ) of each layer.
    """
    n = len(ising.h)
    circuit = _empty(n)
    circuit.h(range(n))
    for beta, gamma in schedule:
        _fields(circuit, 2 * gamma * ising.h)
        for i in range(n):
            for j in range(i + 1, n):
                if ising.coupling[i, j] != 0:
                    circuit.rzz(2 * gamma * ising.coupling[i, j], i, j)
        circuit.rx(-2 * beta, range(n))
    circuit.measure(range(n), range(n))
    return circuit


def swap_network_circuit(ising: Ising, schedule: Sequence[tuple[float, float]]) -> Any:
    """`dense_qaoa_circuit` with gates between neighbours only: a swap network.

    In n rounds of neighbours' swaps each pair is side by side exactly once, and the order comes out
    reversed. Each swap and its RZZ are one block, for the transpiler to join.
    """
    from qiskit.circuit.library import UnitaryGate
    from qiskit.quantum_info import Operator

    n = len(ising.h)
    circuit = _empty(n)
    circuit.h(range(n))
    at = list(range(n))
    for beta, gamma in schedule:
        _fields(circuit, 2 * gamma * ising.h[at])
        for turn in range(n):
            for left in range(turn % 2, n - 1, 2):
                pair = _empty(2)
                pair.rzz(2 * gamma * ising.coupling[at[left], at[left + 1]], 0, 1)
                pair.swap(0, 1)
                circuit.append(UnitaryGate(Operator(pair)), [left, left + 1])
                at[left], at[left + 1] = at[left + 1], at[left]
        circuit.rx(-2 * beta, range(n))
    circuit.measure(range(n), at)
    return circuit


def _empty(n: int) -> Any:
    from qiskit import QuantumCircuit

    return QuantumCircuit(n, n)


def _fields(circuit: Any, angles: Any) -> None:
    for qubit, angle in enumerate(angles):
        if angle != 0:
            circuit.rz(angle, qubit)


def _xy_gate(circuit: Any, angle: float, qubit: int) -> None:
    from qiskit.circuit.library import XXPlusYYGate

    if angle != 0:
        circuit.append(XXPlusYYGate(angle), [qubit, qubit + 1])


def _starts(ansatz: OneHotAnsatz) -> list[int]:
    return [sum(ansatz.groups[:g]) for g in range(len(ansatz.groups))]

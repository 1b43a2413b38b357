"""Ansätze as Qiskit circuits; classical bit q is the chain's qubit q."""

from __future__ import annotations

from typing import Any

from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz, OneHotAnsatz, spread_pairs


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
    starts = [sum(ansatz.groups[:g]) for g in range(len(ansatz.groups))]
    for size, start, hot in zip(ansatz.groups, starts, ansatz.hot, strict=True):
        for pair in spread_pairs(size, hot - start):
            _xy_gate(circuit, ansatz.spread[start + pair], start + pair)
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

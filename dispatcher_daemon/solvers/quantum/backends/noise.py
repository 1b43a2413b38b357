"""A device's noise on a circuit, split exactly into error-free runs and rare errors.

The circuit is divided into blocks of at most two qubits. What noise adds to a block is a channel
E = (1 − p) · identity + p · R with the least p for which R is a channel, so that a shot is an
error-free run unless one of the blocks draws its R: a convex mixture, without approximation.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.complex128]

NEGLIGIBLE = 1e-12
"""Error probabilities below are rounding."""


@dataclass(frozen=True)
class NoiseBlock:
    """Gates in a row on one or two qubits, and what noise adds after them.

    Attributes:
        qubits: that it acts on; the first is the least significant.
        unitary: of its gates, without noise.
        error: probability p of the rest R.
        kraus: operators of R; empty where p = 0.
    """

    qubits: tuple[int, ...]
    unitary: Matrix
    error: float
    kraus: tuple[Matrix, ...]


class DeviceNoise:
    """What `qiskit_aer.noise` derives from a target's calibration, by gate as it is asked for.

    Depolarisation that makes up the calibrated gate error together with relaxation by T1 and T2
    over the gate, and readout errors. Idle time and crosstalk are not in it.

    Attributes:
        target: `qiskit.transpiler.Target`.
    """

    def __init__(self, target: Any) -> None:
        self.target = target
        self._gates: dict[tuple[str, tuple[int, ...]], Any] = {}

    def gate(self, name: str, qubits: tuple[int, ...]) -> Any:
        """`SuperOp` that follows a gate; None where it is free of errors."""
        if (name, qubits) not in self._gates:
            self._gates[name, qubits] = self._derive(name, qubits)
        return self._gates[name, qubits]

    def readout(self, qubit: int) -> tuple[float, float]:
        """P(1 measured | 0) and P(0 measured | 1)."""
        from qiskit_aer.noise.device import basic_device_readout_errors

        for _, error in basic_device_readout_errors(target=self._part("measure", (qubit,))):
            (_, wrong_1), (wrong_0, _) = error.probabilities
            return float(wrong_1), float(wrong_0)
        return 0.0, 0.0

    def _derive(self, name: str, qubits: tuple[int, ...]) -> Any:
        from qiskit.quantum_info import SuperOp
        from qiskit_aer.noise.device import basic_device_gate_errors

        for _, _, error in basic_device_gate_errors(target=self._part(name, qubits)):
            return SuperOp(error)
        return None

    def _part(self, name: str, qubits: tuple[int, ...]) -> Any:
        """A target with nothing but one gate, its qubits counted from 0."""
        from qiskit.transpiler import Target

        known = self.target.qubit_properties
        part = Target(
            num_qubits=len(qubits),
            qubit_properties=[known[q] for q in qubits] if known else None,
        )
        operation = self.target.operation_from_name(name)
        properties = copy.copy(self.target[name].get(qubits))
        if properties is not None:
            properties.error = self._error(name, properties.error)
        part.add_instruction(operation, {tuple(range(len(qubits))): properties}, name=name)
        return part

    def _error(self, name: str, calibrated: float | None) -> float | None:
        """Error of a gate that is noise's, of its calibrated one."""
        return calibrated


def blocks_of(circuit: Any, noise: DeviceNoise | None) -> list[NoiseBlock]:
    """A circuit of gates on one and two qubits as blocks, in an order that may be executed.

    A gate joins the block that its qubits are in if that is one; measurements are passed over.
    """
    from qiskit.quantum_info import Operator

    builders: list[_BlockBuilder] = []
    latest: dict[int, _BlockBuilder] = {}
    for instruction in circuit.data:
        operation = instruction.operation
        if operation.name in {"measure", "barrier", "delay"}:
            continue
        qubits = tuple(circuit.find_bit(q).index for q in instruction.qubits)
        if len(qubits) > 2:
            raise ValueError(f"a gate on {len(qubits)} qubits: {operation.name}")
        into = latest.get(qubits[0])
        if into is None or any(latest.get(q) is not into for q in qubits[1:]):
            into = _BlockBuilder(qubits)
            for qubit in qubits:
                before = latest.get(qubit)
                if before is not None and len(before.qubits) == 1 and len(qubits) == 2:
                    into.absorb(before)
                    builders.remove(before)
                latest[qubit] = into
            builders.append(into)
        error = noise.gate(operation.name, qubits) if noise else None
        into.join(Operator(operation), error, qubits)
    return [g.block() for g in builders]


class _BlockBuilder:
    """A block to which gates are appended."""

    def __init__(self, qubits: tuple[int, ...]) -> None:
        from qiskit.quantum_info import Operator, SuperOp

        self.qubits = qubits
        self.unitary: Any = Operator(np.eye(2 ** len(qubits)))
        self.channel: Any = SuperOp(np.eye(4 ** len(qubits)))

    def join(self, gate: Any, noise: Any, qubits: tuple[int, ...]) -> None:
        """Append a gate and its noise."""
        from qiskit.quantum_info import SuperOp

        where = [self.qubits.index(q) for q in qubits]
        self.unitary = self.unitary.compose(gate, qargs=where)
        self.channel = self.channel.compose(SuperOp(gate), qargs=where)
        if noise is not None:
            self.channel = self.channel.compose(noise, qargs=where)

    def absorb(self, before: _BlockBuilder) -> None:
        """Append a block, gates and noise."""
        where = [self.qubits.index(q) for q in before.qubits]
        self.unitary = self.unitary.compose(before.unitary, qargs=where)
        self.channel = self.channel.compose(before.channel, qargs=where)

    def block(self) -> NoiseBlock:
        """The finished block."""
        from qiskit.quantum_info import SuperOp

        error = SuperOp(self.unitary).adjoint().compose(self.channel)
        p, kraus = rare_part(error)
        return NoiseBlock(self.qubits, np.asarray(self.unitary.data), p, kraus)


def rare_part(channel: Any) -> tuple[float, tuple[Matrix, ...]]:
    """(p, Kraus operators of R) with channel = (1 − p) identity + p R and the least p.

    With Λ the Choi matrix and |I⟩⟩ the identity as a vector, Λ − c |I⟩⟩⟨⟨I| is positive up to
    c = 1 / ⟨⟨I| Λ⁻¹ |I⟩⟩, and only for c = 0 if |I⟩⟩ has a part outside Λ's range.
    """
    from qiskit.quantum_info import Choi

    choi = np.asarray(Choi(channel).data)
    dimension = int(np.sqrt(len(choi)))
    identity = np.eye(dimension).ravel(order="F")
    values, vectors = np.linalg.eigh((choi + choi.conj().T) / 2)
    kept = values > NEGLIGIBLE
    parts = np.abs(vectors.conj().T @ identity) ** 2
    share = 0.0 if parts[~kept].sum() > 1e-9 else 1 / float((parts[kept] / values[kept]).sum())
    p = max(0.0, 1 - share)
    if p < NEGLIGIBLE:
        return 0.0, ()
    rest = (choi - share * np.outer(identity, identity)) / p
    values, vectors = np.linalg.eigh((rest + rest.conj().T) / 2)
    kraus = [
        np.sqrt(value) * vector.reshape(dimension, dimension, order="F")
        for value, vector in zip(values, vectors.T, strict=True)
        if value > NEGLIGIBLE
    ]
    # Rounding leaves Σ K†K a little off the identity.
    total = np.sum([k.conj().T @ k for k in kraus], axis=0)
    weights, basis = np.linalg.eigh(total)
    root = (basis / np.sqrt(weights)) @ basis.conj().T
    return p, tuple(np.asarray(k @ root) for k in kraus)

"""Shots of a noisy circuit from Aer: error-free shots drawn together, the others one by one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.solvers.quantum.backends.noise import DeviceNoise, NoiseBlock, blocks_of

Bits = npt.NDArray[np.int8]


def sample_noisy(circuit: Any, noise: DeviceNoise, shots: int, seed: int) -> dict[str, int]:
    """Counts by Qiskit bit string of a measured circuit on physical qubits.

    Qubits without gates are left out; the others are simulated in the order of the classical bits
    that they are measured into. Which blocks err is drawn for all shots at once; shots with the
    same errors are one circuit.

    Args:
        circuit: gates on one and two qubits, then measurements.
        noise: of its gates and readouts.
        shots: number of samples.
        seed: of all draws.
    """
    rng = np.random.default_rng(seed)
    measured = measured_qubits(circuit)
    blocks = blocks_of(circuit, noise)
    order = _simulation_order(measured, blocks)
    patterns = _draw_errors(np.array([b.error for b in blocks]), shots, rng)
    by_shots: dict[int, list[tuple[int, ...]]] = {}
    for pattern, count in sorted(patterns.items()):
        by_shots.setdefault(count, []).append(pattern)
    rows: list[Bits] = []
    for count, group in by_shots.items():
        circuits = [_with_errors(blocks, pattern, order, len(measured)) for pattern in group]
        rows.append(_run(circuits, count, int(rng.integers(1, 2**31))))
    bits = np.concatenate(rows)
    flips = np.array([noise.readout(qubit) for qubit in measured])
    bits ^= rng.random(bits.shape) < np.where(bits == 0, flips[:, 0], flips[:, 1])
    return counts_of(bits)


def noiseless(circuit: Any) -> Any:
    """A measured circuit in blocks, which Aer runs sooner than gate by gate."""
    measured = measured_qubits(circuit)
    blocks = blocks_of(circuit, None)
    return _with_errors(blocks, (), _simulation_order(measured, blocks), len(measured))


def measured_qubits(circuit: Any) -> list[int]:
    """The qubit that is measured into each classical bit, by bit."""
    found: dict[int, int] = {}
    for instruction in circuit.data:
        if instruction.operation.name == "measure":
            bit = circuit.find_bit(instruction.clbits[0]).index
            found[bit] = circuit.find_bit(instruction.qubits[0]).index
    if sorted(found) != list(range(circuit.num_clbits)):
        raise ValueError("not every classical bit is measured into")
    return [found[bit] for bit in range(circuit.num_clbits)]


def counts_of(bits: Bits) -> dict[str, int]:
    """Counts by bit string, bit 0 last; rows are shots."""
    patterns, counts = np.unique(bits, axis=0, return_counts=True)
    return {
        "".join("1" if bit else "0" for bit in row[::-1]): int(count)
        for row, count in zip(patterns, counts, strict=True)
    }


def _simulation_order(measured: Sequence[int], blocks: Sequence[NoiseBlock]) -> dict[int, int]:
    """Simulated qubit of each that is measured or has gates; the measured ones come first."""
    order = {qubit: i for i, qubit in enumerate(measured)}
    for block in blocks:
        for qubit in block.qubits:
            order.setdefault(qubit, len(order))
    return order


def _draw_errors(
    p: npt.NDArray[np.float64], shots: int, rng: np.random.Generator
) -> Mapping[tuple[int, ...], int]:
    """How many shots have an error in just these blocks."""
    found: Counter[tuple[int, ...]] = Counter()
    for start in range(0, shots, 1024):
        hits = rng.random((min(1024, shots - start), len(p))) < p
        found.update(tuple(int(i) for i in np.flatnonzero(row)) for row in hits)
    return found


def _with_errors(
    blocks: Sequence[NoiseBlock], erring: tuple[int, ...], order: Mapping[int, int], measured: int
) -> Any:
    from qiskit import QuantumCircuit
    from qiskit.circuit import Instruction
    from qiskit.circuit.library import UnitaryGate

    circuit = QuantumCircuit(len(order), measured)
    for number, block in enumerate(blocks):
        qubits = [order[q] for q in block.qubits]
        circuit.append(UnitaryGate(block.unitary, check_input=False), qubits, copy=False)
        if number in erring:
            circuit.append(Instruction("kraus", len(qubits), 0, list(block.kraus)), qubits)
    circuit.measure(range(measured), range(measured))
    return circuit


def _run(circuits: list[Any], shots: int, seed: int) -> Bits:
    from qiskit_aer import AerSimulator

    simulator = AerSimulator(
        method="matrix_product_state", seed_simulator=seed, max_parallel_threads=1
    )
    result = simulator.run(circuits, shots=shots).result()
    if not result.success:
        raise RuntimeError(f"Aer: {result.status}")
    rows = []
    for number in range(len(circuits)):
        for text, count in sorted(result.get_counts(number).items()):
            rows += [[int(c) for c in reversed(text)]] * count
    return np.array(rows, dtype=np.int8)

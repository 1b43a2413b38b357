"""Dense QAOA: its circuits, and an estimate of its figures under a device's noise.

With 25 qubits and all couplings no noise model can be sampled shot by shot in reasonable time: a
shot with an error needs a state vector of its own.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, Final

from dispatcher_daemon.solvers.quantum import Ising, ramp_of, to_ising
from dispatcher_daemon.solvers.quantum.backends import (
    DeviceNoise,
    NoisyBackend,
    blocks_of,
    transpile_on,
    two_qubit_depth,
    two_qubit_gates,
)
from dispatcher_daemon.solvers.quantum.chain import heavy_path
from slipstream_lab.research.quantum.case import QuantumCase
from slipstream_lab.research.quantum.ideal import dense_qaoa_figures
from slipstream_lab.research.quantum.store import Record

SEED: Final = 1
"""Of the transpiler's random choices."""

ESTIMATE: Final = (
    "an estimate (global depolarising), as 25 qubits with all couplings cannot be sampled with "
    "noise: s · P_ideal + (1 − s) · P_uniform, with s the exact share of error-free shots under "
    "the noise model of gates and readout (idle time is not in it), of the better of a routed "
    "circuit and a swap network. It tends to be low, as a shot with a late error still scores"
)


def dense_qaoa_circuit(ising: Ising, schedule: Sequence[tuple[float, float]]) -> Any:
    """QAOA with all couplings, measured, for comparison with the chain.

    Each layer is e^{−iγC}, then e^{+iβΣX}.

    Args:
        ising: normalised; couplings of 0 get no gate.
        schedule: (β, γ) of each layer.
    """
    from qiskit import QuantumCircuit

    n = len(ising.h)
    circuit = QuantumCircuit(n, n)
    circuit.h(range(n))
    for beta, gamma in schedule:
        _add_fields(circuit, 2 * gamma * ising.h)
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
    from qiskit import QuantumCircuit
    from qiskit.circuit.library import UnitaryGate
    from qiskit.quantum_info import Operator

    n = len(ising.h)
    circuit = QuantumCircuit(n, n)
    circuit.h(range(n))
    at = list(range(n))
    for beta, gamma in schedule:
        _add_fields(circuit, 2 * gamma * ising.h[at])
        for turn in range(n):
            for left in range(turn % 2, n - 1, 2):
                pair = QuantumCircuit(2, 2)
                pair.rzz(2 * gamma * ising.coupling[at[left], at[left + 1]], 0, 1)
                pair.swap(0, 1)
                circuit.append(UnitaryGate(Operator(pair)), [left, left + 1])
                at[left], at[left + 1] = at[left + 1], at[left]
        circuit.rx(-2 * beta, range(n))
    circuit.measure(range(n), at)
    return circuit


def transpile_dense(circuit: Any, target: Any) -> Any:
    """A circuit without a chain's shape, as well as the transpiler's highest level can."""
    from qiskit.transpiler import generate_preset_pass_manager

    passes = generate_preset_pass_manager(optimization_level=3, target=target, seed_transpiler=SEED)
    return passes.run(circuit)


def dense_candidates(
    ising: Ising, schedule: Sequence[tuple[float, float]], target: Any, qubits: Sequence[int]
) -> dict[str, Any]:
    """Dense QAOA on a target by two methods, on whose better one it is judged.

    Args:
        ising: in chain order, normalised.
        qubits: physical qubits of the target's best chain, for the swap network.
    """
    return {
        "routed": transpile_dense(dense_qaoa_circuit(ising, schedule), target),
        "swap network": transpile_on(swap_network_circuit(ising, schedule), target, qubits),
    }


def _add_fields(circuit: Any, angles: Any) -> None:
    for qubit, angle in enumerate(angles):
        if angle != 0:
            circuit.rz(angle, qubit)


def error_free_share(circuit: Any, noise: DeviceNoise) -> float:
    """Share of the shots of a transpiled circuit in which no gate or readout errs.

    Args:
        circuit: of gates on one and two physical qubits, measured.
        noise: of its device.
    """
    share = 1.0
    for block in blocks_of(circuit, noise):
        share *= 1 - block.error
    for instruction in circuit.data:
        if instruction.operation.name == "measure":
            qubit = circuit.find_bit(instruction.qubits[0]).index
            # The likelier readout error: bits are mostly 0 in valid states.
            share *= 1 - min(noise.readout(qubit))
    return share


def estimate(case: QuantumCase, layers: int, backend: NoisyBackend) -> Record:
    """Estimate of dense QAOA's shares under noise, by `ESTIMATE`: no bound from either side.

    Args:
        layers: depth p of a ramp.
        backend: whose noise and connections.
    """
    began = time.perf_counter()
    schedule = ramp_of("x", layers)
    ideal = dense_qaoa_figures(case.model, schedule)
    ising = to_ising(case.model.total, case.model.variables)
    ising = ising.permuted(heavy_path(ising.coupling)).normalised()
    qubits = backend.place(len(ising.h)).qubits
    candidates = dense_candidates(ising, schedule, backend.target, qubits).values()
    share, circuit = max(
        ((error_free_share(c, backend.noise), c) for c in candidates), key=lambda pair: pair[0]
    )
    return {
        "wall_s": time.perf_counter() - began,
        "p_feasible": share * ideal.p_feasible + (1 - share) * ideal.uniform_feasible,
        "p_optimal": share * ideal.p_optimal + (1 - share) * ideal.uniform_optimal,
        "error_free": share,
        "two_qubit_depth": two_qubit_depth(circuit),
        "two_qubit_gates": two_qubit_gates(circuit),
        "optimal_cost": case.optimum_kwh,
    }

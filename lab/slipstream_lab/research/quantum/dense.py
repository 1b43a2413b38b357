"""Dense QAOA in the tables: exact simulation, and an estimate under a device's noise.

With 25 qubits and all couplings no noise model can be sampled shot by shot in reasonable time: a
shot with an error needs a state vector of its own.
"""

from __future__ import annotations

import time
from typing import Any, Final

from dispatcher_daemon.settings import QaoaSettings
from dispatcher_daemon.solvers.quantum import (
    dense_qaoa_circuit,
    ramp_of,
    swap_network_circuit,
    to_ising,
)
from dispatcher_daemon.solvers.quantum.backends import (
    DeviceNoise,
    NoisyBackend,
    blocks_of,
    transpile_dense,
    transpile_on,
    two_qubit_depth,
    two_qubit_gates,
)
from dispatcher_daemon.solvers.quantum.chain import heavy_path
from slipstream_lab.research.quantum.case import Case
from slipstream_lab.research.quantum.ideal import dense_qaoa_figures
from slipstream_lab.research.quantum.store import Record

ESTIMATE: Final = (
    "an estimate (global depolarising), as 25 qubits with all couplings cannot be sampled with "
    "noise: s · P_ideal + (1 − s) · P_uniform, with s the exact share of error-free shots under "
    "the noise model of gates and readout (idle time is not in it), of the better of a routed "
    "circuit and a swap network. It tends to be low, as a shot with a late error still scores"
)


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


def estimate(case: Case, options: QaoaSettings, backend: NoisyBackend) -> Record:
    """Estimate of dense QAOA's shares under noise, by `ESTIMATE`: no bound from either side.

    Args:
        options: p and the ramp of the angles.
        backend: whose noise and connections.
    """
    began = time.perf_counter()
    schedule = ramp_of(options)
    ideal = dense_qaoa_figures(case.model, schedule)
    ising = to_ising(case.model.total, case.model.variables)
    ising = ising.permuted(heavy_path(ising.coupling)).normalised()
    qubits = backend.place(len(ising.h)).qubits
    candidates = [
        transpile_dense(dense_qaoa_circuit(ising, schedule), backend.target),
        transpile_on(swap_network_circuit(ising, schedule), backend.target, qubits),
    ]
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

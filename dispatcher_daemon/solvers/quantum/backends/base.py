"""The protocol of backends, and what they share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from dispatcher_daemon.solvers.protocol import BackendKind
from dispatcher_daemon.solvers.quantum.backends.targets import (
    transpile_on,
    two_qubit_depth,
    two_qubit_gates,
)
from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement, place_chain

OVERHEAD_S = 5.0
"""Assumed upper bound of a job's charge besides its shots, s."""
SHOT_S = 5e-4
"""Assumed upper bound of a shot's time, s: twice the default 250 µs between shots, with a circuit
of some 10 µs and its readout."""


def device_s(shots: int) -> float:
    """Upper bound of the device time that a job is charged, s; also its limit on a device."""
    return float(math.ceil(OVERHEAD_S + SHOT_S * shots))


@dataclass(frozen=True)
class Sampled:
    """Measurement results of a backend.

    Attributes:
        counts: shots by bit string (Qiskit's order: qubit 0 last).
        backend, kind: where they come from.
        two_qubit_depth: layers of two-qubit gates of the circuit as it ran.
        two_qubit_gates: their number.
        sample_s: time from handing the circuit over to its samples, transpilation included, s.
        job: the service's id of the job, if there was one.
        fallback: why they are not of the requested backend; None if they are.
    """

    counts: Mapping[str, int]
    backend: str
    kind: BackendKind
    two_qubit_depth: int
    two_qubit_gates: int
    sample_s: float
    job: str | None = None
    fallback: str | None = None


class Backend(Protocol):
    """A simulator or a device that samples circuits."""

    @property
    def name(self) -> str:
        """As `open_backend` takes it."""
        ...

    @property
    def kind(self) -> BackendKind:
        """A simulation without noise, one with a device's noise model, or a device."""
        ...

    @property
    def target(self) -> Any:
        """The device's `qiskit.transpiler.Target`; None from a simulator without a device."""
        ...

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """Placement of a chain of n qubits (`place_chain`); bonds that it cuts get an angle of 0.

        A simulator without a device cuts nothing.
        """
        ...

    def sample(self, circuit: Any, shots: int, seed: int, wait_s: float = 900.0) -> Sampled:
        """Samples of a measured circuit of a chain, which is laid on the best physical chain.

        Args:
            circuit: `qiskit.QuantumCircuit` with gates between neighbours only.
            shots: number of samples.
            seed: of a simulation; devices have none.
            wait_s: for a device, s; its job is cancelled after that.

        Raises:
            InputError: the circuit does not fit the device.
        """
        ...


class DeviceOnTarget:
    """What a job service does by its device's target alone; see `JobService`."""

    @property
    def target(self) -> Any:
        """The device's `qiskit.transpiler.Target`."""
        raise NotImplementedError

    def estimate_s(self, circuit: Any, shots: int) -> float:
        """See `JobService.estimate_s`; it is also a job's time limit at a service."""
        return device_s(shots)

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """See `Backend.place`."""
        return place_chain(self.target, n, bond_weights=bond_weights)

    def two_qubit(self, circuit: Any) -> tuple[int, int]:
        """See `JobService.two_qubit`."""
        transpiled = fit(circuit, self.target)
        return two_qubit_depth(transpiled), two_qubit_gates(transpiled)


def fit(circuit: Any, target: Any) -> Any:
    """Transpile a chain's circuit for a target, on its best chain.

    Raises:
        InputError: too many qubits, or a chain that the device cannot lay without a cut where the
            circuit has a gate.
    """
    gated = set()
    for instruction in circuit.data:
        if len(instruction.qubits) == 2 and instruction.operation.name != "barrier":
            gated.add(min(circuit.find_bit(q).index for q in instruction.qubits))
    n = circuit.num_qubits
    weights = [float("inf") if q in gated else 0.0 for q in range(n - 1)]
    return transpile_on(circuit, target, place_chain(target, n, bond_weights=weights).qubits)

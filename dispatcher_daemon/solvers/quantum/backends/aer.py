"""Simulation by Qiskit Aer: without noise, or with that of a device's calibration snapshot."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from dispatcher_daemon.solvers.protocol import BackendKind
from dispatcher_daemon.solvers.quantum.backends.base import Sampled, fit, is_chain
from dispatcher_daemon.solvers.quantum.backends.idle import IdleNoise, sample_with_idle
from dispatcher_daemon.solvers.quantum.backends.noise import DeviceNoise
from dispatcher_daemon.solvers.quantum.backends.targets import (
    two_qubit_depth,
    two_qubit_gates,
    with_fractional_gates,
)
from dispatcher_daemon.solvers.quantum.backends.trajectories import noiseless, sample_noisy
from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement, place_chain
from slipstream.errors import InputError

STATE_VECTOR_QUBITS = 27
"""A circuit without a chain's shape is simulated as a state vector up to here, without noise."""
NOISY_STATE_VECTOR_QUBITS = 14
"""The same with noise, where many shots need a state vector of their own."""
FRACTIONAL, IDLE, DECOUPLED, TWIRLED = "+fractional", "+idle", "+dd", "+twirl"
ENDINGS = (FRACTIONAL, *(IDLE + dd + twirl for dd in ("", DECOUPLED) for twirl in ("", TWIRLED)))
"""What may follow a fake device's name."""


@dataclass(frozen=True)
class AerBackend:
    """Aer without noise: matrix product state for chains, state vector otherwise.

    Circuits run as they are, so that depth and gates are those of the logical circuit.
    """

    name: str = "aer"
    kind: BackendKind = "simulated"
    target: Any = None

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """See `Backend.place`."""
        return QubitPlacement(tuple(range(n)), (), 1.0)

    def sample(self, circuit: Any, shots: int, seed: int) -> Sampled:
        """See `Backend.sample`."""
        from qiskit_aer import AerSimulator

        began = time.perf_counter()
        chain = is_chain(circuit)
        if not chain and circuit.num_qubits > STATE_VECTOR_QUBITS:
            raise InputError(
                self.name,
                f"{circuit.num_qubits} qubits that are no chain do not fit a state vector",
                f"take at most {STATE_VECTOR_QUBITS} qubits or a chain",
            )
        simulator = AerSimulator(
            method="matrix_product_state" if chain else "statevector",
            precision="double" if chain else "single",
            # Aer drops a seed of 0.
            seed_simulator=seed % 2**31 + 1,
            max_parallel_threads=1 if chain else 0,
        )
        result = simulator.run(noiseless(circuit) if chain else circuit, shots=shots).result()
        if not result.success:
            raise RuntimeError(f"Aer: {result.status}")
        return _sampled(dict(result.get_counts()), circuit, began)


@dataclass(frozen=True)
class NoisyBackend:
    """Aer with the noise of a fake device, on the circuit as transpiled for it.

    Attributes:
        device: class name in `qiskit_ibm_runtime.fake_provider`.
        ending: "" or one of `ENDINGS`: with RZZ and RX gates added to the device
            (`with_fractional_gates`); or with errors of idle time and coherent ones, both assumed
            (`backends.idle`), and dynamical decoupling and Pauli twirling against them.

    Raises:
        InputError: there is no such ending.
    """

    device: str
    ending: str = ""
    kind: BackendKind = "noise-model"

    def __post_init__(self) -> None:
        if self.ending not in ("", *ENDINGS):
            raise InputError(
                "backend",
                f"a fake device cannot have {self.ending!r}",
                f"leave it out, or take one of {' '.join(ENDINGS)}",
            )

    @property
    def name(self) -> str:
        """As `open_backend` takes it."""
        return f"aer:{self.device}{self.ending}"

    @property
    def target(self) -> Any:
        """See `Backend.target`."""
        return self._model()[0]

    @property
    def noise(self) -> DeviceNoise:
        """The device's noise."""
        return self._model()[1]

    def _model(self) -> tuple[Any, DeviceNoise]:
        return _model(self.device, self.ending == FRACTIONAL, self.ending.startswith(IDLE))

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """See `Backend.place`."""
        return place_chain(self.target, n, bond_weights=bond_weights)

    def sample(self, circuit: Any, shots: int, seed: int) -> Sampled:
        """See `Backend.sample`."""
        began = time.perf_counter()
        chain = is_chain(circuit)
        if not chain and circuit.num_qubits > NOISY_STATE_VECTOR_QUBITS:
            raise InputError(
                self.name,
                f"{circuit.num_qubits} qubits that are no chain take too long with noise",
                f"take at most {NOISY_STATE_VECTOR_QUBITS} qubits, a chain, or the backend aer",
            )
        transpiled = fit(circuit, self.target)
        method, noise = "matrix_product_state" if chain else "statevector", self.noise
        if isinstance(noise, IdleNoise):
            counts = sample_with_idle(
                transpiled,
                noise,
                shots,
                seed,
                decoupled=DECOUPLED in self.ending,
                twirled=TWIRLED in self.ending,
                method=method,
            )
        else:
            counts = sample_noisy(transpiled, noise, shots, seed, method=method)
        return _sampled(counts, transpiled, began)


def _sampled(counts: dict[str, int], circuit: Any, began: float) -> Sampled:
    """Counts of a circuit as it ran, since ``began`` by `time.perf_counter`."""
    return Sampled(
        counts=counts,
        two_qubit_depth=two_qubit_depth(circuit),
        two_qubit_gates=two_qubit_gates(circuit),
        sample_s=time.perf_counter() - began,
    )


@lru_cache(maxsize=4)
def fake_target(device: str) -> Any:
    """Target of a snapshot in `qiskit_ibm_runtime.fake_provider`, named after its class.

    Raises:
        InputError: there is no such snapshot.
    """
    from qiskit_ibm_runtime import fake_provider

    maker = getattr(fake_provider, device, None) if device.startswith("Fake") else None
    if not isinstance(maker, type) or not hasattr(maker, "backend_name"):
        raise InputError(
            "backend",
            f"there is no fake device {device!r}",
            "name a class of qiskit_ibm_runtime.fake_provider, such as FakeBoston",
        )
    target = maker().target
    target.description = device
    return target


@lru_cache(maxsize=4)
def _model(device: str, fractional: bool, idle: bool) -> tuple[Any, DeviceNoise]:
    """Target and noise, which learns a gate's noise once."""
    target = fake_target(device)
    if fractional:
        target = with_fractional_gates(target)
    return target, IdleNoise(target) if idle else DeviceNoise(target)

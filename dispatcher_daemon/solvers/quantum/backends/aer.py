"""Simulation by Qiskit Aer: without noise, or with that of a device's calibration snapshot."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

from dispatcher_daemon.solvers.protocol import BackendKind
from dispatcher_daemon.solvers.quantum.backends.base import Sampled, fit
from dispatcher_daemon.solvers.quantum.backends.noise import DeviceNoise
from dispatcher_daemon.solvers.quantum.backends.targets import (
    two_qubit_depth,
    two_qubit_gates,
    with_fractional_gates,
)
from dispatcher_daemon.solvers.quantum.backends.trajectories import noiseless, sample_noisy
from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement, place_chain
from slipstream.errors import InputError

FRACTIONAL: Final = "+fractional"
"""May follow a fake device's name."""


@dataclass(frozen=True)
class AerBackend:
    """Aer without noise; circuits run as they are, so depth and gates are the logical circuit's."""

    name: str = "aer"
    kind: BackendKind = "simulated"
    target: Any = None

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """See `Backend.place`."""
        return QubitPlacement(tuple(range(n)), (), 1.0)

    def sample(self, circuit: Any, shots: int, seed: int, wait_s: float = 900.0) -> Sampled:
        """See `Backend.sample`."""
        from qiskit_aer import AerSimulator

        began = time.perf_counter()
        simulator = AerSimulator(
            method="matrix_product_state",
            # Aer drops a seed of 0.
            seed_simulator=seed % 2**31 + 1,
            max_parallel_threads=1,
        )
        result = simulator.run(noiseless(circuit), shots=shots).result()
        if not result.success:
            raise RuntimeError(f"Aer: {result.status}")
        return sampled(self, dict(result.get_counts()), circuit, began)


@dataclass(frozen=True)
class NoisyBackend:
    """Aer with the noise of a fake device, on the circuit as transpiled for it.

    Attributes:
        device: class name in `qiskit_ibm_runtime.fake_provider`.
        fractional: RZZ and RX gates are added to the device, see `with_fractional_gates`.
    """

    device: str
    fractional: bool = False
    kind: BackendKind = "noise-model"

    @property
    def name(self) -> str:
        """As `open_backend` takes it."""
        return f"aer:{self.device}{FRACTIONAL if self.fractional else ''}"

    @property
    def target(self) -> Any:
        """See `Backend.target`."""
        return _model(self.device, self.fractional).target

    @property
    def noise(self) -> DeviceNoise:
        """The device's noise."""
        return _model(self.device, self.fractional)

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """See `Backend.place`."""
        return place_chain(self.target, n, bond_weights=bond_weights)

    def sample(self, circuit: Any, shots: int, seed: int, wait_s: float = 900.0) -> Sampled:
        """See `Backend.sample`."""
        began = time.perf_counter()
        transpiled = fit(circuit, self.target)
        counts = sample_noisy(transpiled, self.noise, shots, seed)
        return sampled(self, counts, transpiled, began)


def sampled(backend: Any, counts: dict[str, int], circuit: Any, began: float) -> Sampled:
    """Counts of a circuit as it ran on a backend, since ``began`` by `time.perf_counter`."""
    return Sampled(
        counts=counts,
        backend=backend.name,
        kind=backend.kind,
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
def _model(device: str, fractional: bool) -> DeviceNoise:
    """Noise, which learns a gate's noise once, and its target."""
    target = fake_target(device)
    return DeviceNoise(with_fractional_gates(target) if fractional else target)

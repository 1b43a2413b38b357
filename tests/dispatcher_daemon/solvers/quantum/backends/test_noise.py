from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from qiskit.quantum_info import Kraus, SuperOp
from qiskit_aer import AerSimulator
from qiskit_aer.noise import NoiseModel, depolarizing_error, thermal_relaxation_error

from dispatcher_daemon.solvers.quantum.backends.noise import DeviceNoise, blocks_of, rare_part
from dispatcher_daemon.solvers.quantum.backends.targets import transpile_on
from dispatcher_daemon.solvers.quantum.backends.trajectories import noiseless, sample_noisy
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from tests.dispatcher_daemon.solvers.quantum.devices import (
    frequencies,
    line,
    make_target,
    probabilities,
    random_chain,
    random_one_hot,
)


def channels() -> list[Any]:
    """What devices do: depolarisation with relaxation, T2 below and above T1, and damping alone."""
    short = thermal_relaxation_error(50e3, 30e3, 900)
    long = thermal_relaxation_error(50e3, 90e3, 900)
    return [
        SuperOp(depolarizing_error(0.01, 1)),
        SuperOp(depolarizing_error(0.02, 1).compose(short)),
        SuperOp(depolarizing_error(0.02, 2).compose(long.tensor(short))),
        SuperOp(thermal_relaxation_error(50e3, 100e3, 900)),
        SuperOp(np.eye(4)),
    ]


@pytest.mark.parametrize("channel", channels())
def test_a_channel_is_split_into_identity_and_a_channel(channel: Any) -> None:
    """(1 − p) · identity + p R is the channel, and R preserves the trace."""
    p, kraus = rare_part(channel)
    total = (1 - p) * np.eye(len(channel.data))
    if kraus:
        rest = Kraus(list(kraus))
        assert rest.is_cptp()
        total = total + p * SuperOp(rest).data
    assert total == pytest.approx(channel.data, abs=1e-9)


def test_pauli_noise_errs_as_rarely_as_it_can() -> None:
    """Depolarisation by λ leaves 1 − 3λ/4 of the identity."""
    assert rare_part(channels()[0])[0] == pytest.approx(0.0075)
    assert rare_part(channels()[-1]) == (0.0, ())


def noisy_device() -> Any:
    """Four qubits in a row, some ten times worse than a device of today."""
    return make_target(
        {(0, 1): 0.03, (1, 2): 0.02, (2, 3): 0.05},
        gate={0: 2e-3, 1: 5e-3, 2: 1e-3, 3: 3e-3},
        readout={0: 0.02, 1: 0.08, 2: 0.01, 3: 0.04},
        t1_s=2e-5,
        t2_s=3e-5,
    )


@pytest.mark.slow
@pytest.mark.parametrize("make", [random_chain, random_one_hot])
def test_samples_are_those_of_the_density_matrix(make: Any) -> None:
    """2,500 shots agree with Aer's density matrix under its own noise model, noise and all."""
    target = noisy_device()
    circuit = circuit_of(make(4 if make is random_chain else (2, 2), 2, 7))
    transpiled = transpile_on(circuit, target, [3, 2, 1, 0])
    device = SimpleNamespace(
        version=2, target=target, operation_names=list(target.operation_names), dt=1e-9
    )
    simulator = AerSimulator(
        method="density_matrix", noise_model=NoiseModel.from_backend(device), seed_simulator=3
    )
    exact = frequencies(simulator.run(transpiled, shots=60_000).result().get_counts())
    shots = 2_500
    counts = sample_noisy(transpiled, DeviceNoise(target), shots, 1)
    assert sum(counts.values()) == shots
    deviation = np.abs(frequencies(counts) - exact)
    assert np.all(deviation < 5 * np.sqrt(exact * (1 - exact) / shots) + 4e-3)
    # The test would notice if the noise were left out.
    assert np.abs(probabilities(circuit) - exact).max() > 0.02


@pytest.mark.slow
def test_the_seed_fixes_the_samples() -> None:
    """Same seed, same counts; another seed, others; 0 is a seed."""
    target = noisy_device()
    transpiled = transpile_on(circuit_of(random_chain(4, 1, 2)), target, range(4))
    noise = DeviceNoise(target)

    def draw(seed: int) -> dict[str, int]:
        return sample_noisy(transpiled, noise, 200, seed)

    assert draw(0) == draw(0)
    assert draw(0) != draw(1)


def test_blocks_without_noise_are_the_circuit() -> None:
    """Gathering gates into blocks keeps what they do, also for gates on single qubits only."""
    for ansatz in (random_chain(5, 3, 4), random_one_hot((3, 1, 2), 2, 5)):
        circuit = circuit_of(ansatz)
        assert probabilities(noiseless(circuit)) == pytest.approx(probabilities(circuit), abs=1e-9)
        assert all(block.error == 0 for block in blocks_of(circuit, None))


@pytest.mark.slow
def test_a_better_device_errs_more_rarely() -> None:
    """The chance of an error-free run grows with better gates."""
    shares = []
    for error in (0.02, 0.002):
        target = make_target(line(4, error))
        transpiled = transpile_on(circuit_of(random_chain(4, 1, 2)), target, range(4))
        blocks = blocks_of(transpiled, DeviceNoise(target))
        shares.append(np.prod([1 - block.error for block in blocks]))
    # Six CZ with a Pauli error in 1.25 × 0.02 of the cases: depolarisation's average fidelity.
    assert shares[0] == pytest.approx((1 - 1.25 * 0.02) ** 6, abs=0.01)
    assert shares[1] > shares[0]

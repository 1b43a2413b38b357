"""Idle time, coherent errors, and what decoupling and twirling do to them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from qiskit import QuantumCircuit
from qiskit.circuit.library import RZZGate
from qiskit.quantum_info import Operator, average_gate_fidelity

from dispatcher_daemon.solvers.quantum.backends import NoisyBackend
from slipstream.errors import InputError
from slipstream_lab.research.quantum.backends import idle
from slipstream_lab.research.quantum.backends.idle import IdleBackend, IdleNoise
from slipstream_lab.research.quantum.backends.opening import open_backend

SHOTS = 2_000


@pytest.fixture(scope="module")
def noise() -> IdleNoise:
    """Of FakeBoston."""
    return IdleBackend("FakeBoston").noise


def on_device(noise: IdleNoise, bits: int) -> QuantumCircuit:
    """An empty circuit on the device's qubits."""
    return QuantumCircuit(noise.target.num_qubits, bits)


def sample(circuit: Any, noise: IdleNoise, *, decoupled: bool, twirled: bool) -> dict[str, int]:
    """Counts of ``SHOTS`` samples."""
    return idle.sample_with_idle(circuit, noise, SHOTS, 3, decoupled=decoupled, twirled=twirled)


@pytest.mark.slow
def test_decoupling_undoes_a_detuning(noise: IdleNoise, monkeypatch: pytest.MonkeyPatch) -> None:
    """|+⟩ turns by the detuning during 8 µs; two pulses turn it back."""
    monkeypatch.setattr(idle, "DETUNING_HZ", 200e3)
    circuit = on_device(noise, 1)
    circuit.sx(0)
    circuit.delay(2_000, 0, unit="dt")
    circuit.sx(0)
    circuit.measure(0, 0)
    lost = sample(circuit, noise, decoupled=False, twirled=False)
    kept = sample(circuit, noise, decoupled=True, twirled=False)
    assert lost.get("1", 0) < 0.8 * SHOTS
    assert kept["1"] > 0.93 * SHOTS
    pulses = idle.scheduled(circuit, noise.target, decoupled=True).count_ops()
    assert pulses["x"] == 2


@pytest.mark.long
def test_twirling_makes_rotations_add_up_as_errors(
    noise: IdleNoise, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sixteen rotations by φ turn |+⟩ by 16 φ; in random Pauli frames their signs are random."""
    turn, gates = 0.25, 16
    monkeypatch.setattr(IdleNoise, "rotation_rad", lambda *_: turn)
    monkeypatch.setattr(idle, "GROUPS", 24)
    pair = next(iter(noise.target["cz"]))
    circuit = on_device(noise, 1)
    circuit.sx(pair[0])
    for _ in range(gates):
        circuit.cz(*pair)
    circuit.sxdg(pair[0])
    circuit.measure(pair[0], 0)
    circuit = on_device_gates(circuit, noise)
    alone = sample(circuit, noise, decoupled=False, twirled=False)
    framed = sample(circuit, noise, decoupled=False, twirled=True)
    error = 0.06  # of forty gates and a readout
    assert alone["1"] / SHOTS == pytest.approx(math.sin(gates * turn / 2) ** 2, abs=error + 0.06)
    assert framed["1"] / SHOTS == pytest.approx((1 - math.cos(turn) ** gates) / 2, abs=error + 0.05)


def on_device_gates(circuit: QuantumCircuit, noise: IdleNoise) -> Any:
    """The one-qubit gates as the device's, the others as they are."""
    from qiskit.transpiler import PassManager
    from qiskit.transpiler.passes import Optimize1qGatesDecomposition

    return PassManager([Optimize1qGatesDecomposition(target=noise.target)]).run(circuit)


def test_a_gates_error_is_split(noise: IdleNoise) -> None:
    """The rotation has its share of the calibrated error, the channel the rest."""
    plain = NoisyBackend("FakeBoston").noise
    for pair in list(noise.target["cz"])[:5]:
        calibrated = noise.target["cz"][pair].error
        turned = average_gate_fidelity(Operator(RZZGate(noise.rotation_rad(pair))))
        assert 1 - turned == pytest.approx(idle.COHERENT_SHARE * calibrated, rel=1e-6)
        rest, whole = (1 - average_gate_fidelity(n.gate("cz", pair)) for n in (noise, plain))
        assert whole == pytest.approx(calibrated, rel=1e-3)
        assert rest == pytest.approx((1 - idle.COHERENT_SHARE) * calibrated, rel=0.2)


def test_idle_time_decays_by_t1_and_t2(noise: IdleNoise) -> None:
    """A qubit in |1⟩ decays with T1, and one in |+⟩ loses its phase with T2."""
    known = noise.target.qubit_properties[7]
    steps = 25_000
    waited_s = steps * noise.target.dt
    channel = noise.gate(f"idle_{steps}", (7,)).data
    # Columns of a superoperator are images of |0⟩⟨0|, |1⟩⟨0|, |0⟩⟨1|, |1⟩⟨1|.
    assert channel[3, 3].real == pytest.approx(math.exp(-waited_s / known.t1), rel=1e-6)
    t2 = min(known.t2, 2 * known.t1)
    assert abs(channel[1, 1]) == pytest.approx(math.exp(-waited_s / t2), rel=1e-6)
    assert noise.gate("coherent", (7, 8)) is None


def test_idle_time_is_counted_from_a_qubits_first_gate(noise: IdleNoise) -> None:
    """Before it a qubit is in |0⟩; after the last one it is measured at once."""
    circuit = on_device(noise, 2)
    circuit.sx(0)
    circuit.delay(500, 0, unit="dt")
    circuit.sx(0)
    circuit.sx(1)
    circuit.measure([0, 1], [0, 1])
    timed = idle.scheduled(circuit, noise.target, decoupled=False)
    assert idle.idle_s(timed, noise.target.dt) == pytest.approx({0: 2e-6, 1: 0.0})
    erring = idle.with_coherent_errors(timed, noise, np.ones(noise.target.num_qubits))
    assert [i.operation.name for i in erring.data if "idle" in i.operation.name] == ["idle_500"]


def test_a_device_without_cz_has_no_idle_errors() -> None:
    """It is refused in one line."""
    backend = open_backend("aer:FakeSherbrooke+idle")
    with pytest.raises(InputError, match="no CZ"):
        backend.place(5)

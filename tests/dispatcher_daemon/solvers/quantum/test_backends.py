from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import pytest

from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz
from dispatcher_daemon.solvers.quantum.backends import local, open_backend, open_service
from dispatcher_daemon.solvers.quantum.backends.base import Sampled
from dispatcher_daemon.solvers.quantum.backends.local import LocalService
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from slipstream.errors import InputError
from tests.dispatcher_daemon.solvers.quantum.devices import (
    frequencies,
    probabilities,
    random_chain,
    random_one_hot,
)


def flips(n: int, hot: tuple[int, ...]) -> ChainAnsatz:
    """Almost surely 1 on the hot qubits: |+⟩ by RZ(±π/2) and RX(π/2) to |0⟩ or |1⟩."""
    fields = np.array([[np.pi / 2 if q not in hot else -np.pi / 2 for q in range(n)]])
    return ChainAnsatz(fields, np.zeros((1, n - 1)), np.full((1, n), np.pi / 2))


@pytest.mark.long
@pytest.mark.process
def test_importing_back_ends_loads_no_quantum_library() -> None:
    """Their import costs seconds that only who opens one shall pay."""
    code = "import sys, dispatcher_daemon.solvers.quantum.backends; print('qiskit' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "False"


@pytest.mark.parametrize("text", ["", "aer:", "aer:FakeNope", "aer:os", "fake:FakeBoston", "ibm"])
def test_an_unknown_back_end_is_one_line(text: str) -> None:
    """Bad names come back in one line with what may be used."""
    with pytest.raises(InputError, match="there is no"):
        open_backend(text)
    with pytest.raises(InputError, match="there is no"):
        open_service("aer" if text.startswith("fake") else text.replace("aer:", "fake:"))


@pytest.mark.parametrize(
    "name",
    ["aer", "aer:FakeBoston", "aer:FakeBoston+fractional"],
)
def test_bits_come_back_in_the_chains_order(name: str) -> None:
    """Qubits 0, 3 and 4 of seven in |1⟩ are characters 0, 3 and 4 from the right."""
    backend = open_backend(name)
    assert backend.name == name
    assert backend.place(7).cuts == ()
    sampled = backend.sample(circuit_of(flips(7, (0, 3, 4))), 200, 0)
    assert sum(sampled.counts.values()) == 200
    assert max(sampled.counts, key=lambda text: sampled.counts[text]) == "0011001"
    assert (sampled.two_qubit_depth, sampled.two_qubit_gates) == (0, 0)
    assert backend.kind == ("simulated" if name == "aer" else "noise-model")


@pytest.mark.slow
@pytest.mark.parametrize("ansatz", [random_chain(6, 2, 1), random_one_hot((3, 3), 2, 2)])
def test_aer_samples_what_the_circuit_says(ansatz: ChainAnsatz) -> None:
    """Frequencies of 4,000 shots agree with the state vector; a seed fixes them."""
    backend, circuit = open_backend("aer"), circuit_of(ansatz)
    sampled = backend.sample(circuit, 4_000, 4)
    expected = probabilities(circuit)
    assert np.abs(frequencies(sampled.counts) - expected).max() < 0.04
    assert sampled.counts == backend.sample(circuit, 4_000, 4).counts
    assert backend.sample(circuit, 4_000, 0).counts != sampled.counts


@pytest.mark.long
def test_the_papers_chain_runs_under_bostons_noise() -> None:
    """25 qubits, p = 1: depth 4, 48 CZ, and samples that the noise has changed."""
    backend = open_backend("aer:FakeBoston")
    circuit = circuit_of(random_chain(25, 1, 3))
    sampled = backend.sample(circuit, 64, 1)
    assert (sampled.two_qubit_depth, sampled.two_qubit_gates) == (4, 48)
    assert sum(sampled.counts.values()) == 64
    assert backend.sample(circuit, 64, 1).counts == sampled.counts
    assert open_backend("aer").sample(circuit, 64, 1).counts != sampled.counts


@pytest.mark.long
def test_a_fake_device_is_a_job_service() -> None:
    """Submitted, found by tag, done with counts and a charge; waiting jobs can be cancelled."""
    service = open_service("fake:FakeBoston")
    assert isinstance(service, LocalService)
    circuit = circuit_of(flips(4, (1,)))
    first, second = (service.submit(circuit, 300, ["cycle-7", tag]) for tag in ("a", "b"))
    service.cancel(second)
    assert service.find("cycle-7") == [second, first]
    assert service.find("b") == [second]
    until = time.monotonic() + 30
    while (view := service.look(first)).state in ("queued", "running"):
        assert time.monotonic() < until
        time.sleep(0.02)
    assert view.state == "done"
    assert view.counts is not None
    assert max(view.counts, key=lambda text: view.counts[text]) == "0010"
    assert view.usage_s == service.estimate_s(circuit, 300)
    assert service.look(second).state in ("cancelled", "done")
    assert service.look("local-99").state == "lost"
    assert service.two_qubit(circuit_of(random_chain(4, 2, 1))) == (8, 12)
    service.close()


def test_a_fake_device_does_not_keep_all_jobs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last ones that are over are known, older ones are lost; those that wait stay."""
    monkeypatch.setattr(local, "KEPT", 2)
    service = LocalService("FakeBoston")
    sampled = Sampled({"0": 1}, "aer:FakeBoston", "noise-model", 0, 0, 0.0)
    monkeypatch.setattr(service._backend.__class__, "sample", lambda *_: sampled)
    jobs = []
    for _ in range(6):
        jobs.append(service.submit(None, 1, ["many"]))
        while service.look(jobs[-1]).state in ("queued", "running"):
            time.sleep(0.005)
    assert service.look(jobs[0]).state == "lost"
    assert [service.look(job).state for job in jobs[-3:]] == ["done"] * 3
    assert len(service._jobs) == 3
    assert service.look(jobs[-1], samples=False).counts is None
    service.close()


def test_a_job_that_does_not_fit_fails_by_itself() -> None:
    """A circuit wider than the device is a failed job with its reason, not a fault."""
    service = LocalService("FakeBoston")
    job = service.submit(circuit_of(flips(157, (1,))), 10, [])
    service.close()
    view = service.look(job)
    assert view.state == "failed"
    assert view.reason is not None
    assert "157 are needed" in view.reason

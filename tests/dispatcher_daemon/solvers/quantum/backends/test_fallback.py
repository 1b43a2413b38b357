from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest
from qiskit import QuantumCircuit

from dispatcher_daemon.forms.problem import RouteOption, RouteProblem
from dispatcher_daemon.settings import LcQaoaSettings
from dispatcher_daemon.solvers.protocol import BackendKind
from dispatcher_daemon.solvers.quantum.backends import fallback, open_backend
from dispatcher_daemon.solvers.quantum.backends.aer import AerBackend
from dispatcher_daemon.solvers.quantum.backends.base import Sampled
from dispatcher_daemon.solvers.quantum.backends.fallback import Opened, open_or_fall_back
from dispatcher_daemon.solvers.quantum.backends.ibm import IbmBackend
from dispatcher_daemon.solvers.quantum.backends.jobs import ServiceFault
from dispatcher_daemon.solvers.quantum.lc_qaoa import LcQaoaSolver
from slipstream.errors import InputError


@dataclass(frozen=True)
class Device(AerBackend):
    """A device that does what it is told to: answers, or fails."""

    name: str = "ibm:boston"
    kind: BackendKind = "hardware"
    fault: str | None = None

    def sample(self, circuit: Any, shots: int, seed: int) -> Sampled:
        """Aer's samples, or a fault."""
        if self.fault is not None:
            raise ServiceFault("broken", self.fault)
        return super().sample(circuit, shots, seed)


def flipped() -> Any:
    """A circuit whose every shot is 1."""
    circuit = QuantumCircuit(1, 1)
    circuit.x(0)
    circuit.measure(0, 0)
    return circuit


def test_a_device_that_answers_is_not_replaced() -> None:
    """Its samples, its name, no reason."""
    opened, found = Opened(Device()).sample(flipped(), 7, 1, 5.0)
    assert (opened.backend.name, opened.fallback) == ("ibm:boston", None)
    assert found.counts == {"1": 7}


def test_a_device_that_fails_is_replaced_by_aer_and_that_is_said() -> None:
    """Samples all the same, under the simulator's name, with the device's fault as the reason."""
    opened, found = Opened(Device(fault="job j1 failed: calibration")).sample(flipped(), 7, 1, 5.0)
    assert (opened.backend.name, opened.backend.kind) == ("aer", "simulated")
    assert opened.fallback == "ibm:boston: job j1 failed: calibration"
    assert found.counts == {"1": 7}


def test_a_device_out_of_reach_is_replaced_when_it_is_opened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A service that refuses is no bad input; an unknown name is."""

    def refuse(text: str) -> Any:
        if text.startswith("ibm:"):
            raise ServiceFault("unreachable", "no answer")
        return open_backend(text)

    monkeypatch.setattr(fallback, "open_backend", refuse)
    opened = open_or_fall_back("ibm:boston")
    assert (opened.backend.name, opened.fallback) == ("aer", "ibm:boston: no answer")
    assert open_or_fall_back("aer").fallback is None
    with pytest.raises(InputError):
        open_or_fall_back("nowhere")
    # The solver's outcome tells where its samples come from, and why.
    options = tuple(RouteOption("v", (), cost) for cost in (1.0, 2.0, 3.0))
    solver = LcQaoaSolver(LcQaoaSettings(variant="ramp", shots=20), backend="ibm:boston")
    execution = solver.solve(RouteProblem(("v",), (), options), 20.0, 1).execution
    assert execution is not None
    assert (execution.backend, execution.kind) == ("aer", "simulated")
    assert execution.fallback == "ibm:boston: no answer"


def test_ibms_job_is_waited_for_as_long_as_there_is_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left of the deadline becomes the limit after which the job is cancelled."""
    waited: list[float] = []

    def sample(self: IbmBackend, circuit: Any, shots: int, seed: int) -> Sampled:
        waited.append(self.wait_s)
        raise ServiceFault("unreachable", "job j2 was not done and is cancelled")

    monkeypatch.setattr(IbmBackend, "sample", sample)
    monkeypatch.setattr(IbmBackend, "name", "ibm:boston")
    device: Any = IbmBackend(service=None)  # type: ignore[arg-type]
    opened, _ = Opened(device).sample(flipped(), 3, 1, 12.5)
    assert waited == [12.5]
    assert "j2" in (opened.fallback or "")

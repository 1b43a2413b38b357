"""Back ends by name, and Aer in place of a device that fails."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import pytest
from qiskit import QuantumCircuit

from dispatcher_daemon.forms import RouteOption, RouteProblem
from dispatcher_daemon.settings import LcQaoaSettings
from dispatcher_daemon.solvers import BackendKind
from dispatcher_daemon.solvers.quantum import LcQaoaSolver
from dispatcher_daemon.solvers.quantum.backends import Sampled, ServiceFault
from dispatcher_daemon.solvers.quantum.backends.aer import AerBackend
from slipstream.errors import InputError
from slipstream_lab.research.quantum.backends import opening
from slipstream_lab.research.quantum.backends.opening import WithFallback, open_or_fall_back


@dataclass(frozen=True)
class Device(AerBackend):
    """A device that does what it is told to: answers, or fails."""

    name: str = "ibm:boston"
    kind: BackendKind = "hardware"
    fault: str | None = None

    def sample(self, circuit: Any, shots: int, seed: int, wait_s: float = 900.0) -> Sampled:
        """Aer's samples, or a fault."""
        if self.fault is not None:
            raise ServiceFault("broken", self.fault)
        return super().sample(circuit, shots, seed)


@pytest.mark.parametrize("fault", [None, "job j1 failed: calibration"])
def test_a_device_that_fails_is_replaced_by_aer_and_that_is_said(fault: str | None) -> None:
    """Samples all the same: of the device without a reason, or of Aer with the device's fault."""
    circuit = QuantumCircuit(1, 1)
    circuit.x(0)
    circuit.measure(0, 0)
    found = WithFallback(Device(fault=fault)).sample(circuit, 7, 1, 5.0)
    assert found.counts == {"1": 7}
    assert (found.backend, found.kind) == (
        ("ibm:boston", "hardware") if fault is None else ("aer", "simulated")
    )
    assert found.fallback == (None if fault is None else f"ibm:boston: {fault}")


def test_a_device_out_of_reach_is_replaced_when_it_is_opened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A service that refuses is no bad input; an unknown name is. The solver's outcome says why."""
    open_backend = opening.open_backend

    def refuse(text: str) -> Any:
        if text.startswith("ibm:"):
            raise ServiceFault("unreachable", "no answer")
        return open_backend(text)

    monkeypatch.setattr(opening, "open_backend", refuse)
    assert isinstance(open_or_fall_back("aer"), AerBackend)
    with pytest.raises(InputError):
        open_or_fall_back("nowhere")
    options = tuple(RouteOption("v", (), cost) for cost in (1.0, 2.0, 3.0))
    solver = LcQaoaSolver(
        LcQaoaSettings(variant="ramp", shots=20), backend=partial(open_or_fall_back, "ibm:boston")
    )
    execution = solver.solve(RouteProblem(("v",), (), options), 20.0, 1).execution
    assert execution is not None
    assert (execution.backend, execution.kind) == ("aer", "simulated")
    assert execution.fallback == "ibm:boston: no answer"

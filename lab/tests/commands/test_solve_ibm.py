"""`slipstream solve` on a device of IBM Quantum, whose service is a stand-in."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from slipstream_cli.main import main
from tests.dispatcher_daemon.solvers.quantum.backends.ibm_stand_in import (
    DEVICE,
    INSTANCE,
    TOKEN,
    IbmStandIn,
    serving,
)

ASKED = (
    *("solve", "--instance", "arc06-valley", "--solver", "lc-qaoa", "--variant", "ramp"),
    *("--p", "1", "--shots", "64", "--no-controls", "--json", "--deadline", "20"),
)


@pytest.fixture(scope="module")
def stand_in() -> Iterator[IbmStandIn]:
    """The service, with this process's credentials for it."""
    with pytest.MonkeyPatch.context() as patch, serving(IbmStandIn()) as service:
        for name, value in (
            ("QISKIT_FUNCTIONS_EXPERIMENTAL", "1"),
            ("IAM_URL", service.address),
            ("SLIPSTREAM_IBM_URL", service.address),
            ("QISKIT_IBM_TOKEN", TOKEN),
            ("QISKIT_IBM_INSTANCE", INSTANCE),
        ):
            patch.setenv(name, value)
        yield service


def solve(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    """The trial as JSON; neither stream has the token."""
    status = main([*ASKED, *arguments])
    captured = capsys.readouterr()
    assert TOKEN not in captured.out + captured.err
    assert status == 0, captured.err
    (trial,) = json.loads(captured.out)["solvers"]
    return dict(trial)


@pytest.mark.long
def test_a_device_that_answers_is_called_hardware(
    stand_in: IbmStandIn, capsys: pytest.CaptureFixture[str]
) -> None:
    """Job id, depth of the circuit as it ran, and no fallback."""
    trial = solve(capsys, "--backend", f"ibm:{DEVICE}")
    assert (trial["backend"], trial["kind"]) == (f"ibm:{DEVICE}", "hardware")
    assert trial["fallback"] is None
    assert trial["job"] in stand_in.jobs
    assert trial["shots"] == 64
    assert trial["two_qubit_depth"] <= 4


@pytest.mark.long
def test_a_job_that_fails_is_told_and_aer_answers(
    stand_in: IbmStandIn, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The service breaks at submission: an answer all the same, simulated and said to be so."""
    monkeypatch.setitem(stand_in.status, "/jobs", 503)
    trial = solve(capsys, "--backend", f"ibm:{DEVICE}")
    assert (trial["backend"], trial["kind"]) == ("aer", "simulated")
    assert DEVICE in trial["fallback"]
    assert trial["job"] is None


def test_a_device_that_the_account_has_not_is_bad_input(
    stand_in: IbmStandIn, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line that names what there is."""
    assert main([*ASKED, "--backend", "ibm:ibm_nowhere"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert DEVICE in error

"""`slipstream bench device` as an operator meets it."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest

from slipstream_cli.main import main
from tests.dispatcher_daemon.solvers.quantum.backends.ibm_stand_in import (
    DEVICE,
    INSTANCE,
    TOKEN,
    IbmStandIn,
    serving,
)

Capture = pytest.CaptureFixture[str]

TINY = ("bench", "device", "--widths", "4", "--layers", "1", "--shots", "64")


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> Iterator[IbmStandIn]:
    """The service, with this process's credentials for it."""
    with serving(IbmStandIn()) as service:
        for name, value in (
            ("QISKIT_FUNCTIONS_EXPERIMENTAL", "1"),
            ("IAM_URL", service.address),
            ("SLIPSTREAM_IBM_URL", service.address),
            ("QISKIT_IBM_TOKEN", TOKEN),
            ("QISKIT_IBM_INSTANCE", INSTANCE),
        ):
            monkeypatch.setenv(name, value)
        yield service


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["aer", "aer:FakeBoston"])
def test_a_simulated_device_is_marked_and_above_random(capsys: Capture, backend: str) -> None:
    """The same with the same seed, but for times; and the table says the verdict."""
    asked = (*TINY, "--backend", backend, "--seed", "3")
    documents = []
    for _ in range(2):
        assert main([*asked, "--json"]) == 0
        documents.append(json.loads(capsys.readouterr().out))
    for document in documents:
        for cell in document["cells"]:
            del cell["sample_s"]
    assert documents[0] == documents[1]
    (cell,) = documents[0]["cells"]
    assert documents[0]["kind"] == ("simulated" if backend == "aer" else "noise-model")
    assert cell["r"] == pytest.approx(cell["ideal"], abs=6 * cell["error"])
    assert cell["above"]
    assert documents[0]["verdicts"] == [{"width": 4, "above_to": 1, "best": 1, "failed": False}]
    assert main([*asked]) == 0
    printed = capsys.readouterr().out
    assert f"({documents[0]['kind']})" in printed
    assert documents[0]["verdict"] in printed


@pytest.mark.long
def test_a_device_that_answers_has_its_jobs_named(stand_in: IbmStandIn, capsys: Capture) -> None:
    """Hardware, one job a circuit, nothing of the token."""
    assert main([*TINY, "--backend", f"ibm:{DEVICE}", "--json"]) == 0
    captured = capsys.readouterr()
    assert TOKEN not in captured.out + captured.err
    document = json.loads(captured.out)
    assert (document["backend"], document["kind"]) == (f"ibm:{DEVICE}", "hardware")
    assert [cell["job"] for cell in document["cells"]] == list(stand_in.jobs)
    assert document["cells"][0]["above"]


@pytest.mark.long
def test_a_device_that_fails_is_told_and_is_never_replaced(
    stand_in: IbmStandIn, capsys: Capture
) -> None:
    """Exit status 1, the fault in the table, no simulated figure."""
    stand_in.status["/jobs"] = 503
    assert main([*TINY, "--backend", f"ibm:{DEVICE}"]) == 1
    captured = capsys.readouterr()
    assert TOKEN not in captured.out + captured.err
    assert "(hardware)" in captured.out
    assert "no verdict" in captured.out
    assert "503" in captured.out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--backend", "aer:FakeNowhere"), "FakeNowhere"),
        (("--backend", "nonsense"), "nonsense"),
        (("--widths", "1"), "widths"),
        (("--layers", "0"), "layers"),
        (("--shots", "1"), "shots"),
    ],
    ids=["no-such-device", "no-such-service", "narrow", "shallow", "few"],
)
def test_bad_input_is_one_line(capsys: Capture, arguments: tuple[str, ...], said: str) -> None:
    """Exit status 2, and what to mend."""
    assert main(["bench", "device", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert said in error


def test_an_account_that_is_out_of_reach_is_one_line(stand_in: IbmStandIn, capsys: Capture) -> None:
    """Before anything is asked of a device."""
    stand_in.status["/instances/usage"] = 503
    assert main([*TINY, "--backend", f"ibm:{DEVICE}"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--backend" in error

"""Quantum solvers as a user of `slipstream solve` meets them."""

from __future__ import annotations

import importlib.util
import json
from dataclasses import replace
from typing import Any

import pytest

from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Status
from slipstream_cli.main import main
from slipstream_lab.commands.solve.quantum import best_known_kwh
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.forms import arc_form_of

Capture = pytest.CaptureFixture[str]

SMALL = "arc06-valley"


def lc_qaoa(capsys: Capture, *arguments: str) -> dict[str, Any]:
    """The JSON of LC-QAOA on a small instance."""
    asked = ("solve", "--instance", SMALL, "--solver", "lc-qaoa", "--shots", "300", "--json")
    assert main([*asked, *arguments]) == 0
    (trial,) = json.loads(capsys.readouterr().out)["solvers"]
    return dict(trial)


def test_circuit_stages_and_controls_are_in_the_json(capsys: Capture) -> None:
    """Everything that is promised of a quantum trial, and the same again with the same seed."""
    trial = lc_qaoa(capsys, "--p", "1", "--variant", "trained", "--iterations", "20")
    assert (trial["p"], trial["shots"], trial["variant"]) == (1, 300, "trained")
    assert (trial["backend"], trial["kind"], trial["fallback"]) == ("aer", "simulated", None)
    assert trial["qubits"] > 0
    assert 0 < trial["two_qubit_depth"] <= 4
    assert trial["two_qubit_gates"] < 2 * trial["qubits"]
    for stage in ("", "_descended", "_repaired"):
        assert 0 <= trial[f"p_optimal{stage}"] <= trial[f"p_feasible{stage}"] <= 1
    assert trial["p_feasible"] <= trial["p_feasible_descended"]
    assert trial["best_cost"] >= trial["optimal_cost"]  # rounded alike
    assert (trial["seed"], trial["iterations"], trial["optimum_proven"]) == (1, 20, True)
    assert trial["energy_kwh"] == trial["energy"]["total_kwh"]
    assert trial["train_s"] > 0
    assert trial["sample_s"] > 0
    uniform = trial["controls"]["uniform bits"]
    added = trial["added"]["uniform bits"]["p_feasible"]
    assert added["value"] == pytest.approx(trial["p_feasible"] - uniform["p_feasible"])
    assert added["standard_error"] > 0
    again = lc_qaoa(capsys, "--p", "1", "--variant", "trained", "--iterations", "20")
    times = {"wall_s", "train_s", "sample_s"}
    assert {k: v for k, v in trial.items() if k not in times} == {
        k: v for k, v in again.items() if k not in times
    }


def test_dense_qaoa_is_simulated_exactly(capsys: Capture) -> None:
    """QAOA answers with the same fields; there is no circuit whose depth could be told."""
    asked = ("--solver", "qaoa", "--p", "1", "--shots", "200", "--iterations", "5")
    assert main(["solve", "--instance", SMALL, *asked, "--json"]) == 0
    (trial,) = json.loads(capsys.readouterr().out)["solvers"]
    assert (trial["kind"], trial["p"], trial["shots"]) == ("simulated", 1, 200)
    assert trial["two_qubit_depth"] is None
    assert trial["p_optimal"] <= trial["p_feasible"]
    assert "uniform bits" in trial["added"]


def test_controls_can_be_left_out(capsys: Capture) -> None:
    """Without controls there is nothing to compare with, and nothing is compared."""
    trial = lc_qaoa(capsys, "--no-controls", "--variant", "ramp")
    assert trial["controls"] == trial["added"] == {}
    assert trial["p_feasible"] is not None


def test_people_read_stages_and_differences(capsys: Capture) -> None:
    """The circuit, its shares stage by stage, each control, and what the circuit adds, signed."""
    arguments = ("--solver", "lc-qaoa", "--variant", "ramp", "--shots", "200", "--p", "1")
    assert main(["solve", "--instance", SMALL, *arguments]) == 0
    out = capsys.readouterr().out
    for said in ("ramp, p = 1", "(simulated)", "two-qubit depth", "raw", "descended", "repaired"):
        assert said in out
    assert out.count("the circuit adds") == out.count(" ±") / 6 >= 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--solver", "lc-qaoa", "--p", "0"), "--p"),
        (("--solver", "lc-qaoa", "--p", "99"), "--p"),
        (("--solver", "lc-qaoa", "--p", "two"), "--p"),
        (("--solver", "lc-qaoa", "--shots", "0"), "--shots"),
        (("--solver", "lc-qaoa", "--iterations", "-3"), "--iterations"),
        (("--solver", "lc-qaoa", "--variant", "magic"), "--variant: lc-qaoa: "),
        (("--solver", "lc-qaoa", "qaoa", "--variant", "trained"), "--variant: qaoa: "),
        (("--solver", "lc-qaoa", "--backend", "aer:FakeManilaV2"), "FakeManilaV2"),
        (("--solver", "lc-qaoa", "--backend", "aer:FakeBoston+foo"), "+fractional"),
        (("--solver", "lc-qaoa", "--variant", "one-hot"), "--form route"),
        (("--solver", "qaoa", "--variant", "xy"), "--form route"),
        (("--solver", "lc-qaoa", "--backend", "nowhere"), "nowhere"),
        (("--solver", "lc-qaoa", "--backend", "aer:FakeNowhere"), "FakeNowhere"),
        (("--solver", "lc-qaoa", "--backend", "ibm:ibm_boston"), "QISKIT_IBM_TOKEN"),
        (("--solver", "qaoa", "--backend", "aer:FakeBoston"), "lc-qaoa"),
        (("--instance", "arc25-01-avenue", "--encoding", "full", "--solver", "qaoa"), "qubits"),
        (("--solver", "exact", "--p", "2"), "only quantum solvers"),
        (("--backend", "aer"), "only quantum solvers"),
        (("--solver", "lc-qaoa", "--job", "x"), "--solver iskay"),
        (("--solver", "iskay"), "ibm:NAME"),
        (("--solver", "iskay", "--backend", "aer"), "ibm:NAME"),
        (("--solver", "iskay", "--backend", "ibm:least-busy"), "ibm:NAME"),
        (("--solver", "iskay", "--backend", "ibm:ibm_boston"), "QISKIT_IBM_TOKEN"),
        (("--solver", "iskay", "--backend", "ibm:x", "--job", "../x"), "--job"),
    ],
)
def test_bad_input_is_one_line(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], said: str
) -> None:
    """A user's mistake is one line on standard error and exit status 2."""
    for name in ("QISKIT_IBM_TOKEN", "CREDENTIALS_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)
    try:
        status = main(["solve", "--instance", SMALL, *arguments])
    except SystemExit as end:
        status = int(end.code or 0)
    captured = capsys.readouterr()
    assert status == 2
    assert captured.out == ""
    assert captured.err.startswith("slipstream: ")
    assert captured.err.count("\n") == 1
    assert said in captured.err


@pytest.mark.parametrize(("status", "proven"), [("optimal", True), ("feasible", False)])
def test_an_optimum_is_called_one_only_where_it_is_proven(
    monkeypatch: pytest.MonkeyPatch, status: Status, proven: bool
) -> None:
    """The best answer of a search that ran out of time is the best known one."""
    form = arc_form_of(open_instance(SMALL))
    outcome = replace(ExactSolver().solve(form.problem, 10.0, 1), status=status)
    monkeypatch.setattr(ExactSolver, "solve", lambda *_: outcome)
    best, is_proven = best_known_kwh(form, [], 10.0, 1)
    assert best is not None
    assert is_proven is proven


def test_rewards_that_no_platoon_earns_are_told(capsys: Capture) -> None:
    """The arc form's rewards that the timetable does not bear out stand beside the saving."""
    asked = ["solve", "--instance", "arc25-01-avenue"]
    assert main([*asked, "--json"]) == 0
    (trial,) = json.loads(capsys.readouterr().out)["solvers"]
    assert trial["platooned_m"] == 0
    assert trial["missed_rewards_kwh"] == pytest.approx(0.01694, abs=1e-5)
    assert main(asked) == 0
    out = capsys.readouterr().out
    assert "rewards of 0.01694 kWh are counted, no platoon comes about: e-w: who enters" in out


@pytest.mark.skipif(
    importlib.util.find_spec("qiskit_ibm_catalog") is not None, reason="the extra is installed"
)
def test_a_missing_client_of_iskay_names_its_extra(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who has credentials but not the client is told how to install it, in one line."""
    monkeypatch.setenv("QISKIT_IBM_TOKEN", "secret-9")
    asked = ("--solver", "iskay", "--backend", "ibm:ibm_boston")
    assert main(["solve", "--instance", SMALL, *asked]) == 2
    captured = capsys.readouterr()
    assert "slipstream[iskay]" in captured.err
    assert captured.err.count("\n") == 1
    assert "secret-9" not in captured.err + captured.out

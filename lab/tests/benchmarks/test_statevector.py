"""The state-vector benchmark: both sides run one circuit and agree; its arithmetic and its exit."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from slipstream_lab.benchmarks.quantum.statevector import Comparison, compare, main, report

FOUND = Comparison(
    instance="arc25-01-avenue",
    machine="2 cores",
    qubits=25,
    layers=2,
    shots=4096,
    couplings=102,
    diagonal_s=[1.0, 0.5, 0.6],
    ours_s=[1.0, 2.0, 0.9],
    aer_s=[16.0, 12.0, 20.0],
    ours_energy=1.02,
    aer_energy=1.0,
    error=0.01,
)


def test_ratio_is_of_medians() -> None:
    """Without and with the one-off cost."""
    assert FOUND.ratio == 16.0
    assert FOUND.ratio_with_diagonal == 10.0
    assert "| 16.0 | ≥ 8 | reached |" in report(FOUND)
    assert "MISSED" in report(replace(FOUND, aer_s=[7.0]))


def test_different_samples_are_told() -> None:
    """A mean energy more than five standard errors off is no agreement."""
    assert FOUND.agrees
    off = replace(FOUND, aer_energy=0.9)
    assert not off.agrees
    assert "MISSED" in report(off)


def test_both_draw_from_one_state() -> None:
    """On 14 qubits the shots of both have the same mean energy, within what chance allows."""
    found = compare("arc14-avenue", layers=2, shots=4096, repeats=1)
    assert found.agrees
    assert (found.qubits, found.couplings) == (14, 45)
    assert len(found.ours_s) == len(found.aer_s) == len(found.diagonal_s) == 1


def test_json_holds_the_ratios(capsys: pytest.CaptureFixture[str]) -> None:
    """What is printed can be read by a program."""
    main(["--instance", "arc08-blocks", "--repeats", "1", "--shots", "100", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["ratio"] == pytest.approx(found["aer_s"][0] / found["ours_s"][0])
    assert found["ratio_with_diagonal"] <= found["ratio"]


def test_unknown_instance_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Exit status 2, no traceback."""
    assert main(["--instance", "nowhere"]) == 2
    assert capsys.readouterr().err.count("\n") == 1

"""The state-vector benchmark: both sides run one circuit and agree; its exit."""

from __future__ import annotations

import pytest

from slipstream_lab.benchmarks.quantum.statevector import compare, main


def test_both_draw_from_one_state() -> None:
    """On 14 qubits the shots of both have the same mean energy, within what chance allows."""
    ratio, whole, agrees = compare("arc14-avenue", layers=2, shots=4096, repeats=1)
    assert agrees.reached
    assert whole.reached is None
    assert float(whole.measured) <= float(ratio.measured)


def test_unknown_instance_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Exit status 2, no traceback."""
    assert main(["--instance", "nowhere"]) == 2
    assert capsys.readouterr().err.count("\n") == 1

from __future__ import annotations

import json
import math

import pytest

from dispatcher_daemon.solvers.protocol import Execution, Outcome, Samples
from slipstream_lab.research.quantum.record import run_record

EXECUTION = Execution("aer", "simulated", "ramp", 2, 8, 96, 0.5, 0.1, fallback="device late")


def test_stages_and_controls_stand_apart() -> None:
    """Each share under its own name; differences have the control's share taken off, and errors."""
    ours = Samples(25, 100, ((-2.0, 10), (-1.0, 20)), ((-2.0, 40),), ((-3.0, 1), (-2.0, 80)))
    control = Samples(None, 200, ((-1.0, 2),), ((-2.0, 100),), ((-3.0, 20), (-2.0, 150)))
    outcome = Outcome("lc-qaoa", "feasible", frozenset({1}), 1.0, samples=ours)
    record = run_record(outcome, EXECUTION, {"uniform bits": control}, -3.0)
    assert (record["p_feasible"], record["p_optimal"]) == (0.3, 0.0)
    assert (record["p_feasible_descended"], record["p_optimal_descended"]) == (0.4, 0.0)
    assert (record["p_feasible_repaired"], record["p_optimal_repaired"]) == (0.81, 0.01)
    assert (record["best_cost_raw"], record["best_cost"], record["optimal_cost"]) == (-2, -3, -3)
    assert (record["qubits"], record["two_qubit_depth"], record["two_qubit_gates"]) == (25, 8, 96)
    assert (record["fallback"], record["kind"], record["p"]) == ("device late", "simulated", 2)
    theirs = record["controls"]["uniform bits"]
    assert (theirs["p_feasible"], theirs["p_optimal_repaired"]) == (0.01, 0.1)
    added = record["added"]["uniform bits"]
    assert added["p_feasible"]["value"] == pytest.approx(0.29)
    assert added["p_optimal_repaired"]["value"] == pytest.approx(-0.09)
    assert added["p_feasible"]["standard_error"] == pytest.approx(
        math.sqrt(0.3 * 0.7 / 100 + 0.01 * 0.99 / 200), rel=0.05
    )
    json.dumps(record)


def test_a_service_without_samples_has_no_shares() -> None:
    """One post-selected answer: the same keys, no figure."""
    outcome = Outcome("iskay", "feasible", frozenset({1}), 1.0)
    full = Outcome("x", "failed", None, 1.0, samples=Samples(2, 1, (), (), ()))
    record = run_record(outcome, EXECUTION, {}, None)
    assert record.keys() == run_record(full, EXECUTION, {}, None).keys()
    assert record["p_feasible"] is record["p_optimal_repaired"] is record["optimal_cost"] is None

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from qiskit import QuantumCircuit

from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.quantum.backends import NoisyBackend, sample_noisy
from dispatcher_daemon.solvers.quantum.chain.order import heavy_path
from dispatcher_daemon.solvers.quantum.ising import to_ising
from dispatcher_daemon.solvers.quantum.lc_qaoa import counts_to_bits
from slipstream.errors import InputError
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.instance import write_instance
from slipstream_lab.research.proofs.enumeration import valid_selections
from slipstream_lab.research.quantum import dense, rows
from slipstream_lab.research.quantum.case import QuantumCase, named_cases, open_case
from slipstream_lab.research.quantum.rows import (
    BenchSettings,
    QuantumRow,
    hardware_rows,
    lc_qaoa,
    mitigation_rows,
    qaoa,
    sweep_rows,
)

SETTINGS = BenchSettings(shots=200, iterations=5)


@pytest.fixture(scope="module")
def case() -> QuantumCase:
    """A published instance of few variables."""
    return open_case("arc06-valley")


def test_both_tables_have_the_papers_rows_and_say_how_they_are_had() -> None:
    """Exact, Iskay, QAOA simulated and on a device, LC-QAOA by depth; each key once."""
    hardware, sweep = hardware_rows(SETTINGS), sweep_rows(SETTINGS)
    for of_table in (hardware, sweep):
        assert len({row.key for row in of_table}) == len(of_table)
        assert len({(row.title, row.mark) for row in of_table}) == len(of_table)
    selections = {row.key.partition("/")[0]: row.mark for row in hardware[:3]}
    assert selections == {"exact": "classical", "cplex": "classical", "iskay": "hardware"}
    assert {row.mark for row in hardware} == {
        *("classical", "hardware", "simulated", "estimated", "noise-model")
    }
    paper = [row.paper.p_feasible for row in sweep if row.paper and row.mark == "noise-model"]
    assert paper == [0.125, 0.386, 0.378, 0.365, 0.362]
    iskay = hardware[2]
    assert iskay.measure is None
    assert "account" in (iskay.reason or "")


def test_the_named_set_has_proven_optima() -> None:
    """Twenty instances of 25 variables; what has no optimum is refused."""
    assert len(named_cases()) == 20
    assert named_cases(2) == named_cases()[:2]
    one = open_case(named_cases(1)[0])
    assert len(one.model.variables) == 25
    exact = one.measure(ExactSolver(), 10.0, 1)
    assert exact["best_cost"] == pytest.approx(one.optimum_kwh, abs=1e-8)
    assert one.uniform == pytest.approx((6 / 2**16, 1 / 2**16))


def test_an_instance_without_an_optimum_is_refused(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Shares of the optimum need one."""
    path = tmp_path_factory.mktemp("bench") / "open.json"
    write_instance(replace(open_instance("arc06-valley"), optimum=None, energy_optimum=None), path)
    with pytest.raises(InputError, match="optimum"):
        open_case(str(path))


def measured(row: QuantumRow, case: QuantumCase) -> dict[str, object]:
    """A row's record."""
    assert row.measure is not None
    return row.measure(case)


def test_simulated_rows_are_measured_with_their_controls(case: QuantumCase) -> None:
    """LC-QAOA on Aer and dense QAOA: shares, controls, and the exact share of uniform bits."""
    for row in (lc_qaoa(SETTINGS, "trained", 1, "aer"), qaoa(SETTINGS, 1, "transferred")):
        record = measured(row, case)
        assert record["kind"] == row.mark == "simulated"
        assert record["shots"] == 200
        assert record["uniform_exact"] == {
            "p_feasible": case.uniform[0],
            "p_optimal": case.uniform[1],
        }
        assert record["optimal_cost"] == round(case.optimum_kwh, 9)
        assert record["seed"] == SETTINGS.seed + case.number


@pytest.mark.long
def test_a_device_leaves_less_of_dense_qaoa(case: QuantumCase) -> None:
    """The estimate lies between uniform bits and the circuit without noise."""
    record = dense.estimate(case, 1, NoisyBackend("FakeBoston"))
    ideal = dense.dense_qaoa_figures(case.model, dense.ramp_of("x", 1))
    assert 0.5 < record["error_free"] < 1
    low, high = sorted((ideal.uniform_feasible, ideal.p_feasible))
    assert low < record["p_feasible"] < high
    assert record["two_qubit_gates"] > 0


@pytest.mark.slow
def test_the_estimate_is_near_what_a_noisy_simulation_of_a_small_circuit_gives(
    case: QuantumCase,
) -> None:
    """Six qubits at p = 3 can be sampled with noise: the estimate is within a factor of 1.5."""
    layers, backend = 3, NoisyBackend("FakeBoston")
    estimated = dense.estimate(case, layers, backend)
    ising = to_ising(case.model.total, case.model.variables)
    order = heavy_path(ising.coupling)
    schedule = dense.ramp_of("x", layers)
    circuit = dense.dense_qaoa_circuit(ising.permuted(order).normalised(), schedule)
    transpiled = dense.transpile_dense(circuit, backend.target)
    drawn = sample_noisy(transpiled, backend.noise, 2000, 1)
    bits, counts = counts_to_bits(drawn, order)
    valid = valid_selections(case.form.problem)
    numbers = bits[:, : case.form.problem.choices] @ (1 << np.arange(case.form.problem.choices))
    sampled = counts[valid[numbers]].sum() / counts.sum()
    assert 1 / 1.5 < estimated["p_feasible"] / sampled < 1.5


def test_error_free_shots_are_those_without_any_error() -> None:
    """A circuit's share is the product over its gates and readouts."""
    backend = NoisyBackend("FakeBoston")

    def share(flips: int) -> float:
        circuit = QuantumCircuit(156, 1)
        for _ in range(flips):
            circuit.x(5)
        circuit.measure(5, 0)
        return dense.error_free_share(circuit, backend.noise)

    readout = 1 - min(backend.noise.readout(5))
    assert share(0) == pytest.approx(readout)
    assert 0.99 < share(1) / readout < 1
    assert share(40) < share(1)


def test_decoupling_and_twirling_are_rows_of_a_noisy_device() -> None:
    """Off and on for two variants; a back end without a device says why not."""
    found = mitigation_rows(SETTINGS)
    assert len({row.key for row in found}) == len({row.title for row in found}) == 8
    assert {row.key.rpartition("/")[2] for row in found} == {
        f"aer:FakeBoston+idle{ending}" for ending in ("", "+dd", "+twirl", "+dd+twirl")
    }
    none = mitigation_rows(BenchSettings(noise="aer"))
    assert all(row.measure is None and "--noise" in (row.reason or "") for row in none)


@pytest.mark.long
def test_twirling_is_measured_with_idle_errors(case: QuantumCase) -> None:
    """The samples come from the device's noise with all four errors, and have their controls."""
    record = measured(mitigation_rows(SETTINGS)[3], case)
    assert record["backend"] == "aer:FakeBoston+idle+dd+twirl"
    assert record["kind"] == "noise-model"
    assert record["shots"] == 200


def test_cplex_has_a_row_where_it_is_installed(
    monkeypatch: pytest.MonkeyPatch, case: QuantumCase
) -> None:
    """It is solved like the others; where the extra is missing, the row says so."""
    row = next(row for row in hardware_rows(SETTINGS) if row.key == "cplex")
    assert (row.measure is not None) == (find_spec("cplex") is not None)
    monkeypatch.setattr(
        rows, "find_spec", lambda name: None if name == "cplex" else find_spec(name)
    )
    missing = next(row for row in hardware_rows(SETTINGS) if row.key == "cplex")
    assert missing.measure is None
    assert "extra cplex" in (missing.reason or "")
    monkeypatch.setattr(rows, "find_spec", lambda name: object())
    monkeypatch.setattr(rows, "CplexSolver", ExactSolver)
    there = next(row for row in hardware_rows(SETTINGS) if row.key == "cplex")
    assert measured(there, case)["best_cost"] == round(case.optimum_kwh, 9)

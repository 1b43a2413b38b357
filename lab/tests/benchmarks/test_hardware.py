"""Cycles beside a faulty device, in short; in full: `python -m
slipstream_lab.benchmarks.quantum.hardware`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Execution, Outcome
from dispatcher_daemon.solvers.workers.pool import PoolJob, solve_in_process
from slipstream_lab.benchmarks.quantum import hardware, hardware_cycles
from slipstream_lab.benchmarks.quantum.faulty_service import FaultyServiceFactory, ServiceRecords
from slipstream_lab.benchmarks.quantum.hardware_checks import Run, check_run
from slipstream_lab.benchmarks.quantum.hardware_cycles import SETTINGS, run
from storage import open_database

SEED = 5
EXACT = solve_in_process([ExactSolver()])
SHORT = SETTINGS.model_copy(
    update={
        "deadline_s": 2.5,
        "interval_s": 3.0,
        "hardware": SETTINGS.hardware.model_copy(update={"wait_s": 0.15}),
    }
)
LIMITS = replace(hardware_cycles.LIMITS, job_timeout_s=1.0, lost_after_s=0.3)


def solve(jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
    """The exact solver in the simulator's place: this is about the device."""
    ran = Execution("aer", "simulated", "ramp", 2, 4, 40, 0.0, 0.0)
    exact = EXACT([replace(job, solver="exact") for job in jobs], deadline_s)
    return [
        outcome
        if job.solver == "exact"
        else replace(outcome, solver=job.solver, status="feasible", execution=ran)
        for job, outcome in zip(jobs, exact, strict=True)
    ]


@pytest.mark.long
@pytest.mark.process
def test_no_promise_is_broken_in_twenty_cycles(tmp_path: Path) -> None:
    """On time, verified, within the budget, nothing leaked, ledger and records agree; also the
    device must have had its part: jobs were submitted, and the job manager was closed in between.
    """
    ran = run(20, SEED, tmp_path, settings=SHORT, limits=LIMITS, solve=solve, restart_every=10)
    assert ran.broken == []
    assert ran.cycles == 20
    assert ran.restarts >= 1
    assert sum(number for event, number in ran.events.items() if event.startswith("submit")) >= 2
    assert sum(ran.answered.values()) == 20
    assert max(ran.walls_s) <= ran.limit_s == SHORT.deadline_s


@pytest.mark.long
@pytest.mark.process
def test_a_late_cycle_is_a_broken_promise(tmp_path: Path) -> None:
    """Its plan may be good: it has to be stored before the deadline, not some time after it."""

    def late(jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        time.sleep(0.3)
        return solve(jobs, deadline_s)

    settings = SHORT.model_copy(update={"deadline_s": 0.25})
    ran = run(1, SEED, tmp_path, settings=settings, solve=late, checked=False)
    assert any(line.startswith("cycle 1 took") for line in ran.broken)


def test_a_process_that_was_killed_leaves_whole_notes(tmp_path: Path) -> None:
    """A line cut short is no cycle; what is whole counts, and the next process goes on."""
    notes = tmp_path / "stretch-0.jsonl"
    assert list(hardware.read_notes(notes)) == []
    notes.write_text('{"cycle": 1}\n{"cycle": 2}\n{"cyc', encoding="utf-8")
    assert [note["cycle"] for note in hardware.read_notes(notes)] == [1, 2]


def test_the_checks_find_what_is_wrong(tmp_path: Path) -> None:
    """Jobs that are in no ledger, or were submitted twice, and an overdrawn budget are noticed."""
    ran = Run(budget_s=1.0)
    records = ServiceRecords(tmp_path / "service.db")
    service = FaultyServiceFactory(str(records.path))()
    for _ in range(2):
        service.submit(_Width(), 8, ["stray"])
    url = f"sqlite:///{tmp_path}/cycles.db"
    open_database(url).close()
    check_run(records, url, ran)
    assert any("in no ledger" in line for line in ran.broken)
    assert any("submitted twice" in line for line in ran.broken)
    assert any("charged in one window" in line for line in ran.broken)


class _Width:
    num_qubits = 3

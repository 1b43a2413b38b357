"""Cycles beside a faulty device, in short; in full: `python -m benchmarks.quantum.guest`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.quantum import guest
from benchmarks.quantum.faulty_service import Books, Opening
from dispatcher_daemon.solvers.base import Execution, Outcome
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.pool import Job, solve_here
from storage import open_database

SEED = 5
EXACT = solve_here([ExactSolver()])
SHORT = guest.SETTINGS.model_copy(
    update={
        "deadline_s": 0.25,
        "hardware": guest.SETTINGS.hardware.model_copy(
            update={"wait_s": 0.25, "give_up_after_s": 1.0, "lost_after_s": 0.3}
        ),
    }
)


def solve(jobs: Sequence[Job], deadline_s: float) -> list[Outcome]:
    """The exact solver in the simulator's place: this is about the device."""
    ran = Execution("aer", "simulated", "ramp", 2, 4, 40, 0.0, 0.0)
    exact = EXACT([replace(job, solver="exact") for job in jobs], deadline_s)
    return [
        outcome
        if job.solver == "exact"
        else replace(outcome, solver=job.solver, status="feasible", execution=ran)
        for job, outcome in zip(jobs, exact, strict=True)
    ]


def test_no_promise_is_broken_in_twenty_cycles(tmp_path: Path) -> None:
    """On time, verified, within the budget, nothing leaked, ledger and books agree; also the
    device must have had its part: jobs were submitted, and the desk was torn down in between.
    """
    run = guest.run(20, SEED, tmp_path, settings=SHORT, solve=solve, restart_every=10)
    assert run.broken == []
    assert run.cycles == 20
    assert run.restarts >= 1
    assert sum(number for event, number in run.events.items() if event.startswith("submit")) >= 2
    assert sum(run.answered.values()) == 20


def test_the_judge_sees_what_is_wrong(tmp_path: Path) -> None:
    """Jobs that are in no ledger, or were submitted twice, and an overdrawn budget are noticed."""
    run = guest.Run(budget_s=1.0)
    books = Books(tmp_path / "service.db")
    service = Opening(str(books.path))()
    for _ in range(2):
        service.submit(_Width(), 8, ["stray"])
    url = f"sqlite:///{tmp_path}/cycles.db"
    open_database(url).close()
    guest._judge(books, url, run)
    assert any("in no ledger" in line for line in run.broken)
    assert any("submitted twice" in line for line in run.broken)
    assert any("charged in one window" in line for line in run.broken)


class _Width:
    num_qubits = 3

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from dispatcher_daemon.forms.decode import decode
from dispatcher_daemon.forms.problem import ArcProblem
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import GRACE_S, PoolJob, SolverPool, solve_in_process

Demo = Callable[..., ArcProblem]

# Workers are fresh interpreters, so the faulty solver must live in a module that they can import.
FAULTY = """
import os, pathlib, re, time
from dataclasses import dataclass
from dispatcher_daemon.solvers.protocol import Outcome

@dataclass(frozen=True)
class Faulty:
    fault: str
    name: str = "faulty"

    def warm_up(self):
        if self.fault == "cold":
            time.sleep(60)

    def solve(self, problem, deadline_s, seed):
        if self.fault == "hangs":
            pathlib.Path(__file__).with_name("hangs").touch()
            time.sleep(60)
        if self.fault == "keeps the lock":
            re.fullmatch("(a|a)*b", 60 * "a")  # for years, and no other thread has a turn
        if self.fault == "slow":
            time.sleep(0.7)
        if self.fault == "raises":
            raise ValueError("no such\\nluck")
        if self.fault == "dies":
            os._exit(3)
        if self.fault == "garbage":
            return {"routes": "yes"}
        if self.fault == "hangs once" and seed == 1:
            time.sleep(60)
        return Outcome(self.name, "feasible", frozenset(), 0.0, reason=str(os.getpid()))
"""


@pytest.fixture
def faulty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Any]]:
    """Factory of solvers with a fault."""
    (tmp_path / "faulty_solver.py").write_text(FAULTY)
    monkeypatch.syspath_prepend(str(tmp_path))
    import faulty_solver  # type: ignore[import-not-found]

    yield faulty_solver.Faulty
    del sys.modules["faulty_solver"]


@pytest.mark.process
@pytest.mark.parametrize(
    ("fault", "status", "reason"),
    [
        ("hangs", "timeout", "no answer within 3 s"),
        pytest.param("raises", "failed", "ValueError: no such luck", marks=pytest.mark.long),
        ("dies", "failed", "ProcessExpired"),
        pytest.param(
            "garbage", "failed", "TypeError: answered with a dict", marks=pytest.mark.long
        ),
    ],
)
def test_a_faulty_solver_costs_only_its_own_answer(
    faulty: Callable[[str], Any], demo_arcs: Demo, fault: str, status: str, reason: str
) -> None:
    """Hanging, raising, dying or answering nonsense is reported; the others answer, in time."""
    problem = demo_arcs(avenue_east=1)
    with SolverPool([faulty(fault), ExactSolver()]) as pool:
        assert pool.warm_up() == {}
        began = time.monotonic()
        bad, good = pool([PoolJob("faulty", problem, 1), PoolJob("exact", problem, 1)], 3.0)
        assert time.monotonic() - began < 3.0 + GRACE_S + 12
        assert (bad.status, bad.selected) == (status, None)
        assert reason in (bad.reason or "")
        assert good.status == "optimal"
        assert good.selected is not None
        assert decode(problem, good.selected).routes is not None
        assert pool.fault() is None


@pytest.mark.long
@pytest.mark.process
@pytest.mark.parametrize("fault", ["dies", "raises"])
def test_a_pool_without_a_solver_that_works_says_so(
    faulty: Callable[[str], Any], demo_arcs: Demo, fault: str
) -> None:
    """Each solver with its reason, from the first job on."""
    with SolverPool([faulty(fault)]) as pool:
        assert pool.warm_up() == {}
        assert pool.fault() is None
        (outcome,) = pool([PoolJob("faulty", demo_arcs(avenue_east=1), 1)], 30.0)
        assert pool.fault() == f"faulty: {outcome.reason}"


@pytest.mark.long
@pytest.mark.process
def test_a_hung_worker_is_killed_and_replaced(
    faulty: Callable[[str], Any], demo_arcs: Demo
) -> None:
    """After a time-out the next request goes to a new process, and the old one is gone."""
    problem = demo_arcs()
    with SolverPool([faulty("hangs once")]) as pool:
        (before,) = pool([PoolJob("faulty", problem, 2)], 20.0)
        (hung,) = pool([PoolJob("faulty", problem, 1)], 0.3)
        assert hung.status == "timeout"
        (after,) = pool([PoolJob("faulty", problem, 2)], 20.0)
        assert after.status == "feasible"
        assert after.reason != before.reason
        assert not psutil.pid_exists(int(before.reason or ""))


@pytest.mark.long
@pytest.mark.process
def test_jobs_of_one_solver_share_its_time(faulty: Callable[[str], Any], demo_arcs: Demo) -> None:
    """A first job that hangs leaves the second one of the same solver its part of the deadline."""
    with SolverPool([faulty("hangs once")]) as pool:
        pool.warm_up()
        jobs = [PoolJob("faulty", demo_arcs(), seed) for seed in (1, 2)]
        hung, answered = pool(jobs, 20.0)
        assert (hung.status, answered.status) == ("timeout", "feasible")


@pytest.mark.long
@pytest.mark.process
def test_workers_of_one_solver_work_side_by_side(
    faulty: Callable[[str], Any], demo_arcs: Demo
) -> None:
    """Two workers take two jobs at once, each with the whole deadline for its own."""
    with SolverPool([faulty("slow")], workers=2) as pool:
        assert pool.warm_up() == {}
        jobs = [PoolJob("faulty", demo_arcs(), seed) for seed in range(4)]
        outcomes = pool(jobs, 20.0)
    assert [o.status for o in outcomes] == ["feasible"] * 4
    assert len({o.reason for o in outcomes}) == 2


@pytest.mark.long
@pytest.mark.process
def test_a_worker_that_dies_idle_is_replaced(faulty: Callable[[str], Any], demo_arcs: Demo) -> None:
    """Killing the waiting worker (as the kernel does for memory) costs at most one request."""
    problem = demo_arcs()
    with SolverPool([faulty("none")]) as pool:
        (first,) = pool([PoolJob("faulty", problem, 1)], 20.0)
        os.kill(int(first.reason or ""), signal.SIGKILL)
        time.sleep(0.5)
        outcomes = [pool([PoolJob("faulty", problem, 1)], 20.0)[0] for _ in range(2)]
        assert outcomes[-1].status == "feasible"


@pytest.mark.process
def test_warming_up_ends_when_the_daemon_stops(faulty: Callable[[str], Any]) -> None:
    """A daemon that is told to stop while its solvers start does not wait for them."""
    stopping = threading.Event()
    threading.Timer(0.5, stopping.set).start()
    began = time.monotonic()
    with SolverPool([faulty("cold")]) as pool:
        assert "faulty" in pool.warm_up(60.0, stopping)
    assert time.monotonic() - began < 15


@pytest.mark.long
@pytest.mark.process
def test_a_cold_worker_is_reported(faulty: Callable[[str], Any]) -> None:
    """Warming up has its time limit too; who misses it is named."""
    with SolverPool([faulty("cold"), ExactSolver()]) as pool:
        assert "faulty" in pool.warm_up(timeout_s=2.0)


@pytest.mark.long
@pytest.mark.process
def test_closing_frees_a_waiting_caller(
    faulty: Callable[[str], Any], demo_arcs: Demo, tmp_path: Path
) -> None:
    """A cycle that waits for a hanging solver ends as soon as the pool is closed."""
    pool = SolverPool([faulty("hangs")])
    pool.warm_up()
    answers: list[Any] = []
    caller = threading.Thread(
        target=lambda: answers.extend(pool([PoolJob("faulty", demo_arcs(), 1)], 50.0))
    )
    caller.start()
    deadline = time.monotonic() + 20
    while not (tmp_path / "hangs").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    began = time.monotonic()
    pool.close()
    caller.join(timeout=30)
    assert time.monotonic() - began < 20
    assert [a.status for a in answers] == ["timeout"]
    assert [a.status for a in pool([PoolJob("faulty", demo_arcs(), 1)], 5.0)] == ["failed"]


@pytest.mark.long
@pytest.mark.process
def test_workers_end_with_a_killed_parent(tmp_path: Path) -> None:
    """SIGKILL for the dispatcher leaves no worker behind, not even one in compiled code."""
    (tmp_path / "faulty_solver.py").write_text(FAULTY)
    script = tmp_path / "parent.py"
    script.write_text(
        textwrap.dedent(
            """
            from dispatcher_daemon.forms.problem import ArcProblem
            from dispatcher_daemon.solvers.workers.pool import PoolJob, SolverPool
            from faulty_solver import Faulty

            if __name__ == "__main__":
                with SolverPool([Faulty("keeps the lock")]) as pool:
                    pool.warm_up()
                    print("ready", flush=True)
                    pool([PoolJob("faulty", ArcProblem("d", (), (), ()), 1)], 50.0)
            """
        )
    )
    root = Path(__file__).parents[4]
    environment = {**os.environ, "PYTHONPATH": f"{root}:{tmp_path}"}
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, env=environment
    ) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"ready\n"
        time.sleep(0.3)
        children = psutil.Process(parent.pid).children(recursive=True)
        assert children
        parent.kill()
    _, alive = psutil.wait_procs(children, timeout=5)
    assert alive == []


def test_solving_in_place_reports_faults_too(faulty: Callable[[str], Any], demo_arcs: Demo) -> None:
    """Without workers a solver that raises is still only an Outcome."""
    solve = solve_in_process([faulty("raises"), ExactSolver()])
    bad, good = solve([PoolJob("faulty", demo_arcs(), 1), PoolJob("exact", demo_arcs(), 1)], 5.0)
    assert (bad.status, good.status) == ("failed", "optimal")

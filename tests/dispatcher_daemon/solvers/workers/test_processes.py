from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

import psutil
import pytest

from dispatcher_daemon.solvers.workers.processes import Processes, WorkerExecutor

pytestmark = pytest.mark.process


@pytest.fixture(scope="module")
def workers() -> Iterator[WorkerExecutor]:
    """Two processes."""
    with WorkerExecutor(2) as executor:
        yield executor


def test_calls_run_in_other_processes(workers: WorkerExecutor) -> None:
    """Results and errors come back; neither is computed in this process."""
    assert workers.submit(math.hypot, 3.0, 4.0).result(30) == 5.0
    assert list(workers.map(math.sqrt, [1.0, 4.0, 9.0])) == [1.0, 2.0, 3.0]
    assert workers.submit(os.getpid).result(30) != os.getpid()
    with pytest.raises(ValueError, match="math domain error"):
        workers.submit(math.sqrt, -1.0).result(30)


def test_workers_are_forked_with_all_that_they_need(workers: WorkerExecutor) -> None:
    """Loading it in each would take a second, and a call's limit does not wait for it."""
    loaded = workers.submit(eval, "set(__import__('sys').modules)").result(60)
    assert {
        *("dispatcher_daemon.forms", "dispatcher_daemon.solvers.registry"),
        *("dispatcher_daemon.planning.routes.base_routes", "dimod", "pyvrp"),
    } <= loaded


def test_workers_leave_other_work_its_turn(workers: WorkerExecutor) -> None:
    """Their priority is below that of the process that answers callers."""
    own = os.getpriority(os.PRIO_PROCESS, 0)
    assert workers.submit(os.getpriority, os.PRIO_PROCESS, 0).result(30) == min(19, own + 5)


def test_a_killed_worker_costs_its_own_job_only(workers: WorkerExecutor) -> None:
    """A job whose process is killed raises; the one beside it and those after it are answered."""
    beside = workers.submit(time.sleep, 0.5)
    killed = workers.submit(signal.raise_signal, signal.SIGKILL)
    with pytest.raises(Exception, match=r"(?i)abnormal|died|terminated|expired"):
        killed.result(30)
    assert beside.result(30) is None
    assert [workers.submit(abs, -n).result(30) for n in range(4)] == [0, 1, 2, 3]


def test_workers_that_die_are_told_until_one_answers(workers: WorkerExecutor) -> None:
    """So that a dispatcher knows whether it can solve at all."""
    workers.submit(abs, -1).result(60)
    assert workers.fault is None
    killed = workers.submit(signal.raise_signal, signal.SIGKILL)
    assert killed.exception(60) is not None
    assert workers.fault is not None
    assert workers.fault.startswith("ProcessExpired")
    workers.submit(abs, -1).result(60)
    assert workers.fault is None


def test_processes_that_die_as_a_call_comes_cost_that_call_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The pool breaks after it was seen to be alive: the call's future says so, none is raised."""
    with ThreadPoolExecutor(1) as spawner:
        processes = Processes(1, spawner, "processes")
        worker = processes.schedule(os.getpid).result(60)
        broken = processes._living_pool()
        os.kill(worker, signal.SIGKILL)
        while broken.active:
            time.sleep(0.01)
        with monkeypatch.context() as at_once:
            at_once.setattr(processes, "_living_pool", lambda: broken)
            error = processes.schedule(abs, (-1,)).exception(0.0)
        assert isinstance(error, BrokenProcessPool)
        assert processes.fault is not None
        assert processes.schedule(abs, (-1,)).result(60) == 1
        assert processes.fault is None
        processes.stop()


def test_workers_that_died_are_asked_again_where_no_call_comes(workers: WorkerExecutor) -> None:
    """So that a dispatcher with nothing to plan learns that they live; what raised stays so."""

    def asked_again_until_well() -> bool:
        deadline = time.monotonic() + 60
        while workers.fault is not None and time.monotonic() < deadline:
            workers.ask_again(0.0)
            time.sleep(0.05)
        return workers.fault is None

    assert workers.submit(signal.raise_signal, signal.SIGKILL).exception(60) is not None
    workers.ask_again(3600.0)
    assert workers.fault is not None
    assert asked_again_until_well()
    assert workers.submit(int, "x").exception(60) is not None
    workers.ask_again(0.0)
    workers.ask_again(0.0)
    assert (workers.fault or "").startswith("ValueError")


@pytest.mark.long
def test_workers_killed_while_idle_are_replaced(workers: WorkerExecutor) -> None:
    """Somebody kills all processes between two jobs: the next job finds others."""
    pids = {workers.submit(os.getpid).result(30)}
    pids |= {child.pid for child in psutil.Process().children() if child.pid in pids}
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    deadline = time.monotonic() + 60
    answer: Any = None
    while answer is None and time.monotonic() < deadline:
        try:
            answer = workers.submit(os.getpid).result(60)
        except Exception:
            # The job may have been handed to the process that was just killed.
            continue
    assert answer is not None
    assert answer not in pids


def test_shutting_down_ends_jobs_and_refuses_others() -> None:
    """Whoever waits for a job hears of the end at once; no process stays; later jobs fail."""
    executor = WorkerExecutor(1)
    pid = executor.submit(os.getpid).result(30)
    running, waiting = executor.submit(time.sleep, 60), executor.submit(abs, -1)
    threading.Timer(0.3, executor.shutdown).start()
    began = time.monotonic()
    for job in (running, waiting):
        with pytest.raises(CancelledError):
            job.result(20)
    assert time.monotonic() - began < 10
    with pytest.raises(RuntimeError, match="shut down"):
        executor.submit(abs, -1)
    psutil.wait_procs([p for p in psutil.process_iter() if p.pid == pid], timeout=10)
    assert not psutil.pid_exists(pid)
    executor.shutdown()

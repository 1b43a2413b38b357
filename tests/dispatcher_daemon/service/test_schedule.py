from __future__ import annotations

import threading
import time
from datetime import datetime, timedelta, tzinfo

import pytest

from dispatcher_daemon.service.schedule import CycleScheduler
from tests.dispatcher_daemon.service.waiting import wait_for


def test_first_run_is_immediate_and_others_follow() -> None:
    """The first cycle does not wait for an interval to pass; the next one does."""
    for interval_s, runs in ((30.0, 1), (0.3, 3)):
        times: list[float] = []
        began = time.monotonic()
        scheduler = CycleScheduler(lambda times=times: times.append(time.monotonic()), interval_s)
        scheduler.start()
        try:
            assert wait_for(lambda times=times, runs=runs: len(times) >= runs)
            assert scheduler.next_run_ns is not None
            assert abs(scheduler.next_run_ns - time.time_ns()) < (interval_s + 3) * 1e9
        finally:
            scheduler.stop()
        assert scheduler.next_run_ns is None
        assert len(times) < 3 or times[2] - began >= 0.5


def test_nothing_runs_before_the_start() -> None:
    """Not even what is asked for; then the first run comes at once."""
    times: list[float] = []
    scheduler = CycleScheduler(lambda: times.append(time.monotonic()), 3600.0)
    assert scheduler.run_soon()
    assert scheduler.next_run_ns is None
    assert times == []
    began = time.monotonic()
    scheduler.start()
    try:
        assert wait_for(lambda: times)
        assert scheduler.next_run_ns is not None
        assert not scheduler.follow_clock()
    finally:
        scheduler.stop()
    assert times[0] >= began


@pytest.mark.slow
def test_overlapping_runs_are_left_out_and_counted() -> None:
    """A cycle longer than the interval never runs beside itself."""
    running = threading.Semaphore(1)
    clashes: list[str] = []
    runs: list[int] = []
    kinds: list[str] = []

    def run() -> None:
        if not running.acquire(blocking=False):
            clashes.append("two at once")
        runs.append(1)
        time.sleep(0.35)
        running.release()

    scheduler = CycleScheduler(run, 0.1, kinds.append)
    scheduler.start()
    try:
        assert wait_for(lambda: len(runs) >= 2 and kinds.count("overlapped") >= 2)
    finally:
        scheduler.stop()
    assert clashes == []


def test_a_run_that_raises_is_counted_and_the_next_one_comes() -> None:
    """No exception ends the schedule."""
    runs: list[int] = []
    kinds: list[str] = []

    def run() -> None:
        runs.append(1)
        raise RuntimeError("broken")

    scheduler = CycleScheduler(run, 0.05, kinds.append)
    scheduler.start()
    try:
        assert wait_for(lambda: len(runs) >= 3 and kinds.count("raised") >= 3)
    finally:
        scheduler.stop()


def test_stop_waits_for_the_run_that_is_going() -> None:
    """Whoever stops the scheduler may then close what the cycle uses."""
    begun, done = threading.Event(), threading.Event()

    def run() -> None:
        begun.set()
        time.sleep(0.3)
        done.set()

    scheduler = CycleScheduler(run, 60.0)
    scheduler.start()
    assert begun.wait(10)
    scheduler.stop()
    assert done.is_set()
    scheduler.stop()


class Clock(datetime):
    """A wall clock that can be set, to put in the place of `datetime`."""

    ahead = timedelta()

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override]
        """The set time."""
        return datetime.now(tz) + cls.ahead


@pytest.mark.long
@pytest.mark.parametrize("step_s", [-3600.0, 3600.0])
def test_a_clock_that_is_set_does_not_stop_the_cycles(
    monkeypatch: pytest.MonkeyPatch, step_s: float
) -> None:
    """After a step of the wall clock the next cycle runs at once, and the ones after it follow."""
    monkeypatch.setattr(Clock, "ahead", timedelta())
    for module in ("apscheduler.schedulers.base", "apscheduler.executors.base"):
        monkeypatch.setattr(f"{module}.datetime", Clock)
    monkeypatch.setattr("dispatcher_daemon.service.schedule.datetime", Clock)
    runs: list[int] = []
    kinds: list[str] = []
    scheduler = CycleScheduler(lambda: runs.append(1), 2.0, kinds.append)
    scheduler.start()
    try:
        assert wait_for(lambda: len(runs) >= 1, 20.0)
        assert not scheduler.follow_clock()
        # While the schedule sleeps, so that it cannot see the step by itself.
        monkeypatch.setattr(Clock, "ahead", timedelta(seconds=step_s))
        assert scheduler.follow_clock()
        seen = len(runs)
        assert wait_for(lambda: len(runs) >= seen + 2, 20.0)
        assert not scheduler.follow_clock()
    finally:
        scheduler.stop()
    assert not scheduler.follow_clock()
    assert kinds == ["clock"]

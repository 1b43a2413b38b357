"""Keeping processes running."""

from __future__ import annotations

import io
import os
import signal
import sys
import time
from collections.abc import Callable

import psutil
import pytest

from slipstream_lab.commands.live import supervisor as module
from slipstream_lab.commands.live.supervisor import RESTARTS_A_MINUTE, Supervisor

pytestmark = pytest.mark.process


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Supervisor, io.StringIO]]:
    """Starts Python code under a supervisor in place of the daemons."""
    monkeypatch.setattr(module, "_FIRST_WAIT_S", 0.01)
    real = module.subprocess.Popen

    def popen(command: list[str], **options: object) -> object:
        return real([sys.executable, "-c", command[3]], **options)  # type: ignore[call-overload]

    monkeypatch.setattr(module.subprocess, "Popen", popen)

    def start(*codes: str) -> tuple[Supervisor, io.StringIO]:
        log = io.StringIO()
        supervisor = Supervisor(log)
        for number, code in enumerate(codes):
            supervisor.start(f"p{number}", [code])
        return supervisor, log

    return start


def poll_until(supervisor: Supervisor, condition: Callable[[], bool], seconds: float = 15) -> bool:
    """Poll as `slipstream run` does."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        supervisor.poll()
        if condition():
            return True
        time.sleep(0.02)
    return False


SLEEP = "import time; print('up', flush=True); time.sleep(60)"


def test_a_killed_process_is_started_again(started: Callable[..., object]) -> None:
    """It comes back with another process id, and the log says so."""
    supervisor, log = started(SLEEP)  # type: ignore[misc]
    first = supervisor.pids()["p0"]
    os.kill(first, signal.SIGKILL)
    assert poll_until(supervisor, lambda: supervisor.restarted == 1)
    assert supervisor.pids()["p0"] != first
    assert poll_until(supervisor, lambda: "p0          | up" in log.getvalue())
    supervisor.stop()
    assert "p0          | ended with status -9" in log.getvalue()


def test_a_process_that_keeps_dying_is_given_up_and_the_others_live(
    started: Callable[..., object],
) -> None:
    """Restarts are limited, and one fault stays one fault."""
    supervisor, log = started("raise SystemExit(1)", SLEEP)  # type: ignore[misc]
    assert poll_until(supervisor, lambda: "given up" in log.getvalue())
    assert supervisor.restarted == RESTARTS_A_MINUTE
    assert set(supervisor.pids()) == {"p1"}
    supervisor.stop()


def test_bad_input_is_not_tried_again(started: Callable[..., object]) -> None:
    """Exit status 2 will be 2 the next time as well."""
    supervisor, _ = started("raise SystemExit(2)")  # type: ignore[misc]
    assert poll_until(supervisor, lambda: supervisor.refused == "p0")
    assert supervisor.restarted == 0
    supervisor.stop()


def test_stop_ends_even_what_ignores_signals_and_what_was_left_behind(
    started: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within its time limit nothing of a child's session is left."""
    monkeypatch.setattr(module, "_STOP_S", 1.0)
    stubborn = (
        "import signal, subprocess, sys, time\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        "print('child', p.pid, flush=True); time.sleep(60)"
    )
    supervisor, log = started(stubborn)  # type: ignore[misc]
    assert poll_until(supervisor, lambda: "child" in log.getvalue())
    pids = [supervisor.pids()["p0"], int(log.getvalue().split("child ")[1].split()[0])]
    began = time.monotonic()
    supervisor.stop()
    assert time.monotonic() - began < 20
    deadline = time.monotonic() + 15
    while any(runs(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(runs(pid) for pid in pids)


WORKS = """
import sys, time
from slipstream.config import ServiceSettings
from slipstream.service import Service
time.sleep(float("%s"))
with Service("works", ServiceSettings()) as service:
    service.ready()
    while not service.wait(0.1):
        service.progress()
"""


@pytest.mark.attack
@pytest.mark.long
def test_a_stopped_process_is_started_again_and_what_works_is_left_alone(
    started: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGSTOP is noticed by silence; one that reports, and one slow to start, go on."""
    monkeypatch.setattr(module, "WATCHDOG_S", 3.0)
    supervisor, log = started(WORKS % 0, WORKS % 0, WORKS % 8, SLEEP)  # type: ignore[misc]
    before = supervisor.pids()
    try:
        assert poll_until(supervisor, lambda: all(c.ready for c in supervisor._children[:2]), 60)
        os.kill(before["p0"], signal.SIGSTOP)
        assert poll_until(supervisor, lambda: supervisor.restarted == 1, 60)
        assert poll_until(supervisor, lambda: supervisor._children[2].ready, 60)
    finally:
        supervisor.stop()
    assert "p0          | no progress for 3 s; killed" in log.getvalue()
    assert supervisor.restarted == 1
    assert log.getvalue().count("killed") == 1


def test_a_process_that_is_never_ready_is_started_again(
    started: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The start has a limit of its own."""
    monkeypatch.setattr(module, "_START_LIMIT_S", 0.5)
    supervisor, log = started(SLEEP)  # type: ignore[misc]
    assert poll_until(supervisor, lambda: supervisor.restarted == 1)
    supervisor.stop()
    assert "p0          | not ready for 0.5 s; killed" in log.getvalue()


@pytest.mark.attack
@pytest.mark.long
def test_a_machine_that_stalls_is_no_reason_to_restart(
    started: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Supervisor and daemon stand still together for longer than the limit."""
    monkeypatch.setattr(module, "WATCHDOG_S", 2.0)
    monkeypatch.setattr(module, "_MAX_STEP_S", 0.5)
    supervisor, log = started(WORKS % 0)  # type: ignore[misc]
    try:
        (pid,) = supervisor.pids().values()
        assert poll_until(supervisor, lambda: supervisor._children[0].ready, 60)
        assert poll_until(supervisor, lambda: supervisor._children[0].silent_s == 0.0, 60)
        os.kill(pid, signal.SIGSTOP)
        time.sleep(3.0)
        supervisor.poll()
        os.kill(pid, signal.SIGCONT)
        assert poll_until(supervisor, lambda: supervisor._children[0].silent_s == 0.0, 10)
        assert supervisor.restarted == 0, log.getvalue()
    finally:
        supervisor.stop()


def test_json_lines_are_shown_as_text(started: Callable[..., object]) -> None:
    """With the stack of a fault below, each line under the daemon's name."""
    line = (
        '{"time": "2026-11-23T08:00:00.000Z", "level": "ERROR", "daemon": "edge", '
        '"message": "no picture", "exception": "Traceback\\n  ValueError"}'
    )
    supervisor, log = started(f"print({line!r}, flush=True); import time; time.sleep(60)")  # type: ignore[misc]
    try:
        assert poll_until(supervisor, lambda: "ValueError" in log.getvalue())
    finally:
        supervisor.stop()
    shown = [text.partition("| ")[2] for text in log.getvalue().splitlines()]
    assert shown[:3] == ["edge ERROR no picture", "Traceback", "  ValueError"]


def runs(pid: int) -> bool:
    """True unless the process is gone or only waits to be reaped."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False

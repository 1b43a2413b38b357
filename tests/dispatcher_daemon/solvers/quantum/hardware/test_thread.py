"""The job thread: what a fault of our own costs."""

from __future__ import annotations

from typing import Any

import pytest

from dispatcher_daemon.solvers.quantum.hardware import service
from dispatcher_daemon.solvers.quantum.hardware.breaker import JobLimits
from dispatcher_daemon.solvers.quantum.hardware.request import JobRequest
from dispatcher_daemon.solvers.quantum.hardware.thread import JobThread


def test_a_fault_of_our_own_costs_a_step_not_the_thread(
    harness: Any, done: Any, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread goes on after a bug, says so once, and serves what comes next."""
    monkeypatch.setattr(service.ServiceWorker, "call", lambda _, *call: harness.call(*call))
    thread = JobThread(
        harness.settings,
        "hardware",
        harness.service,
        harness.builder,
        harness.store,
        JobLimits(poll_s=0.05),
    )
    broken = [True, True]
    serve = thread._runner.serve

    def serve_at_last(request: JobRequest) -> None:
        if broken:
            broken.pop()
            raise ZeroDivisionError("a bug")
        serve(request)

    thread._runner.serve = serve_at_last  # type: ignore[method-assign]
    harness.service.looks = [done()]
    thread.start()
    requests = [harness.request(stop) for stop in ("x", "y", "z")]
    thread.add(requests)
    requests[2].wait(10.0)
    thread.close()
    assert requests[2].close()[0] is not None
    assert sum("a bug" in record.message for record in caplog.records) == 1

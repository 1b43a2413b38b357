"""Calls in the device's worker: what becomes of those that never come back."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

import pytest

from dispatcher_daemon.hardware import worker
from dispatcher_daemon.hardware.clerk import Clerk
from dispatcher_daemon.hardware.ticket import Ticket
from dispatcher_daemon.solvers.quantum.backends.jobs import ServiceFault


class Stuck:
    """Processes whose pool answers nothing."""

    def __init__(self) -> None:
        self.stopped = 0

    def schedule(self, *_: Any, **__: Any) -> Future[Any]:
        """Never done."""
        return Future()

    def stop(self) -> None:
        """Counted."""
        self.stopped += 1


def test_a_stuck_pool_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where not even the limit's kill comes, the call ends all the same and the pool goes."""
    monkeypatch.setattr(worker, "_START_S", 0.05)
    guest, stuck = worker.GuestWorker(), Stuck()
    guest._processes = stuck  # type: ignore[assignment]
    with pytest.raises(ServiceFault, match="no answer within") as caught:
        guest.call(print, (), 0.01)
    assert (caught.value.kind, stuck.stopped) == ("unreachable", 1)
    guest.close()
    with pytest.raises(worker.WorkerClosed):
        guest.call(print, (), 0.01)


def test_a_fault_of_our_own_costs_a_step_not_the_desk(
    world: Any, done: Any, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread goes on after a bug, says so once, and serves what comes next."""
    monkeypatch.setattr(worker.GuestWorker, "call", lambda _, *call: world.call(*call))
    settings = world.settings.model_copy(update={"poll_s": 0.05})
    clerk = Clerk(settings, "hardware", world.service, world.maker, world.store)
    broken = [True, True]
    serve = clerk._caretaker.serve

    def serve_at_last(ticket: Ticket) -> None:
        if broken:
            broken.pop()
            raise ZeroDivisionError("a bug")
        serve(ticket)

    clerk._caretaker.serve = serve_at_last  # type: ignore[method-assign]
    world.service.looks = [done()]
    clerk.start()
    tickets = [world.ticket(stop) for stop in ("x", "y", "z")]
    clerk.take(tickets)
    tickets[2].wait(10.0)
    clerk.close()
    assert tickets[2].close()[0] is not None
    assert sum("a bug" in record.message for record in caplog.records) == 1

"""Calls in the device's worker: what becomes of those that never come back."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

import pytest

from dispatcher_daemon.solvers.quantum.backends.jobs import ServiceFault
from dispatcher_daemon.solvers.quantum.hardware import service


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
    monkeypatch.setattr(service, "_START_S", 0.05)
    worker, stuck = service.ServiceWorker(), Stuck()
    worker._processes = stuck  # type: ignore[assignment]
    with pytest.raises(ServiceFault, match="no answer within") as caught:
        worker.call(print, (), 0.01)
    assert (caught.value.kind, stuck.stopped) == ("unreachable", 1)
    worker.close()
    with pytest.raises(service.WorkerClosed):
        worker.call(print, (), 0.01)

"""Worker processes as a `concurrent.futures.Executor` that outlives a broken pool."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import ParamSpec, TypeVar

from dispatcher_daemon.solvers.processes import Processes

P = ParamSpec("P")
T = TypeVar("T")


class WorkerExecutor(Executor):
    """Spawned processes that end with this one; if one is killed, the pool is replaced.

    Running jobs of a broken pool raise; later ones run in a new pool.

    Args:
        workers: number of processes.
    """

    def __init__(self, workers: int) -> None:
        self._spawner = ThreadPoolExecutor(1, thread_name_prefix="workers")
        self._processes = Processes(workers, self._spawner, "workers")
        self._lock = threading.Lock()
        self._closed = False

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a picklable call in a worker.

        Raises:
            RuntimeError: it is shut down.
        """
        with self._lock:
            if self._closed:
                raise RuntimeError("the workers are shut down")
            return self._processes.schedule(fn, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop the workers at once; their jobs are cancelled."""
        with self._lock:
            self._closed = True
            self._processes.stop()
        self._spawner.shutdown()

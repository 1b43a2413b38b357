"""Worker processes as a `concurrent.futures.Executor` that outlives a broken pool."""

from __future__ import annotations

import logging
import multiprocessing
import os
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any, ParamSpec, TypeVar

import pebble

from dispatcher_daemon.solvers.pool import start_worker

log = logging.getLogger(__name__)

P = ParamSpec("P")
T = TypeVar("T")


class WorkerExecutor(Executor):
    """Spawned processes that die with this one; if one is killed, others take its place.

    The jobs that a broken pool was at raise; the next ones find a new pool.

    Args:
        workers: number of processes.
    """

    def __init__(self, workers: int) -> None:
        self._size = workers
        self._keeper = ThreadPoolExecutor(1, thread_name_prefix="workers")
        self._lock = threading.Lock()
        self._pool: Any = None
        self._pending: set[Future[Any]] = set()
        self._closed = False

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a picklable call in a worker.

        Raises:
            RuntimeError: it is shut down.
        """
        with self._lock:
            if self._closed:
                raise RuntimeError("the workers are shut down")
            if self._pool is not None and not self._pool.active:
                log.warning("workers broke; starting others")
                self._stop()
            if self._pool is None:
                self._pool = self._keeper.submit(self._start).result()
            future: Future[T] = self._pool.schedule(fn, args=args, kwargs=kwargs)
            self._pending.add(future)
            future.add_done_callback(self._pending.discard)
            return future

    def _start(self) -> Any:
        # In the keeper's thread: a worker is tied to the thread that made it.
        pool = pebble.ProcessPool(
            max_workers=self._size,
            context=multiprocessing.get_context("spawn"),
            initializer=start_worker,
            initargs=(os.getpid(),),
        )
        # Asking whether it is active starts it.
        assert pool.active
        return pool

    def _stop(self) -> None:
        # A stopped pool leaves its futures open; whoever waits for one must hear of it.
        for future in tuple(self._pending):
            future.cancel()
        if self._pool is not None:
            self._pool.stop()
            self._pool.join()
            self._pool = None

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop the workers, whatever they are doing; their jobs are cancelled."""
        with self._lock:
            self._closed = True
            self._stop()
        self._keeper.shutdown()

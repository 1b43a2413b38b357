"""Worker processes that end with this one and are replaced when they fail."""

from __future__ import annotations

import gc
import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, TimeoutError
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from importlib import import_module
from multiprocessing import connection, forkserver
from multiprocessing.context import BaseContext
from typing import Any, Final, ParamSpec, TypeVar

import pebble

from slipstream.service import die_with_parent
from slipstream.service.memory import TRIM_INTERVAL_S, configure_allocator, trim_memory

log = logging.getLogger(__name__)

_NICENESS = 5
"""Of workers: whoever waits for this process, which does little itself, comes before a search."""

_FORMS = "dispatcher_daemon.forms"
"""What reading a problem needs."""
_PRELOAD: Final = "dispatcher_daemon.solvers.workers.preload"


def start_fork_server() -> BaseContext:
    """The way to start workers: they are forked from a server, which has loaded once what each of
    them needs. Loading it takes more than a second; it begins here, in the background.

    The server needs room for a socket among the temporary files. Without it each worker loads for
    itself.
    """
    forkserver.set_forkserver_preload([_PRELOAD])
    try:
        forkserver.ensure_running()
    except OSError as error:
        log.warning("workers cannot be forked, and start slowly: %s", error)
        return multiprocessing.get_context("spawn")
    return multiprocessing.get_context("forkserver")


def start_worker(niceness: int = _NICENESS, modules: Sequence[str] = ()) -> None:
    """End the worker when its parent ends; leave Ctrl-C to the parent, and other work its turn;
    give back what was freed.

    Args:
        modules: imported at once, as a call's time limit does not cover the start of its process.
    """
    configure_allocator()
    with suppress(OSError):
        # A service may be refused it by its system call filter; the work is the same without.
        os.nice(niceness)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The server ends when nobody but its workers' parent holds this, however that one ends.
    held: int | None = getattr(forkserver._forkserver, "_forkserver_alive_fd", None)
    if held is not None:
        os.close(held)
    # With it end its workers: the kernel's signal holds even while compiled code keeps the
    # interpreter lock. Where there is no server, it also fires when the creating thread ends:
    # SolverPool makes workers in threads that live as long as it.
    die_with_parent(os.getppid())
    parent_process = multiprocessing.parent_process()
    if parent_process is not None:
        sentinel = parent_process.sentinel

        def follow() -> None:
            while not connection.wait([sentinel], TRIM_INTERVAL_S):
                trim_memory()
            os._exit(1)

        threading.Thread(target=follow, name="parent-watch", daemon=True).start()
    for module in modules:
        import_module(module)
    # What is loaded stays: looking through it would hold up a solver twice a minute.
    gc.collect()
    gc.freeze()


class Processes:
    """A pool of processes. It is not thread-safe: the caller locks.

    Args:
        spawner: starts the processes, in a thread that outlives them: see `start_worker`.
        name: for the log.
        niceness: of the processes above this one's.
        modules: what calls need, see `start_worker`; problems need no naming.

    Attributes:
        fault: why the last call has no answer, as its process died or it raised; None: it has one.
    """

    def __init__(
        self,
        size: int,
        spawner: ThreadPoolExecutor,
        name: str,
        niceness: int = _NICENESS,
        modules: Sequence[str] = (),
    ) -> None:
        self.size = size
        self._niceness = niceness
        self._modules = (_FORMS, *modules)
        self._spawner = spawner
        self._name = name
        self._pool: Any = None
        self._pending: set[Future[Any]] = set()
        self._asked_at = time.monotonic()
        self._died = False
        self.fault: str | None = None

    def schedule(
        self,
        function: Callable[..., Any],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
        timeout_s: float | None = None,
    ) -> Future[Any]:
        """Run a picklable call; a process that takes longer than its time is killed.

        Where the processes cannot take the call, its future says why; nothing is raised.
        """
        self._asked_at = time.monotonic()
        future: Future[Any]
        try:
            future = self._living_pool().schedule(
                function, args=args, kwargs=dict(kwargs or {}), timeout=timeout_s
            )
        except RuntimeError as error:
            # They died after the pool was seen to be alive.
            future = Future()
            future.set_exception(BrokenProcessPool(str(error)))
        self._pending.add(future)
        future.add_done_callback(self._pending.discard)
        future.add_done_callback(self._note)
        return future

    def _note(self, future: Future[Any]) -> None:
        # A call that was cancelled or ran out of time says nothing of the processes.
        if future.cancelled() or isinstance(error := future.exception(), TimeoutError):
            return
        text = " ".join(str(error).split())[:200]
        self._died = isinstance(error, BrokenProcessPool | pebble.ProcessExpired)
        self.fault = None if error is None else f"{type(error).__name__}: {text}"

    def ask_again(self, after_s: float) -> None:
        """Ask whether processes live, where they died and no call has come for so long since.

        Where nothing is left to do, nobody else would learn that they do.
        """
        if self._died and time.monotonic() - self._asked_at >= after_s:
            self.schedule(os.getpid)

    def _living_pool(self) -> Any:
        """The pool, created again if it broke (a worker that dies while idle breaks it)."""
        if self._pool is not None and not self._pool.active:
            log.warning("%s broke; starting others", self._name)
            self.stop()
        if self._pool is None:
            pool = pebble.ProcessPool(
                max_workers=self.size,
                context=start_fork_server(),
                initializer=start_worker,
                initargs=(self._niceness, self._modules),
            )
            # Reading `active` starts the pool, in the calling thread.
            self._spawner.submit(lambda: pool.active).result()
            self._pool = pool
        return self._pool

    def stop(self) -> None:
        """End the processes at once; their calls are cancelled."""
        # A stopped pool leaves its futures pending; cancelling wakes their waiters.
        for future in tuple(self._pending):
            future.cancel()
        if self._pool is not None:
            self._pool.stop()
            self._pool.join()
            self._pool = None


P = ParamSpec("P")
T = TypeVar("T")


class WorkerExecutor(Executor):
    """Processes that die with this one; if one is killed, others take its place.

    The jobs that a broken pool was at raise; the next ones find a new pool.
    """

    def __init__(self, workers: int) -> None:
        self._keeper = ThreadPoolExecutor(1, thread_name_prefix="workers")
        self._processes = Processes(workers, self._keeper, "workers")
        self._lock = threading.Lock()
        self._closed = False

    @property
    def fault(self) -> str | None:
        """See `Processes`."""
        return self._processes.fault

    def ask_again(self, after_s: float) -> None:
        """See `Processes`."""
        with self._lock:
            if not self._closed:
                self._processes.ask_again(after_s)

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a picklable call in a worker; raises as `submit_limited`."""
        return self.submit_limited(None, fn, *args, **kwargs)

    def submit_limited(
        self, timeout_s: float | None, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """As `submit`; a worker that takes longer than the time is killed and replaced.

        Raises:
            RuntimeError: it is shut down.
        """
        with self._lock:
            if self._closed:
                raise RuntimeError("the workers are shut down")
            return self._processes.schedule(fn, args, kwargs, timeout_s)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop the workers, whatever they are doing; their jobs are cancelled."""
        with self._lock:
            self._closed = True
            self._processes.stop()
        self._keeper.shutdown()

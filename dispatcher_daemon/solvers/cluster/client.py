"""The dispatcher's end of the cluster: connects, watches the workers, sends calls."""

from __future__ import annotations

import asyncio
import concurrent.futures
import itertools
import logging
import threading
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import Future
from typing import Any, Final

from dispatcher_daemon import metrics
from dispatcher_daemon.settings import LOCAL, ClusterSettings
from dispatcher_daemon.solvers.cluster.arrays import SentArrays
from dispatcher_daemon.solvers.cluster.calls import (
    CallAnswer,
    ClusterCall,
    ClusterLost,
    build,
    run_call,
    warm_up,
    write_call,
)
from dispatcher_daemon.solvers.cluster.connection import connected
from dispatcher_daemon.solvers.cluster.security import security_of
from dispatcher_daemon.solvers.workers.pool import error_line
from dispatcher_daemon.solvers.workers.processes import WorkerExecutor

log = logging.getLogger(__name__)

_LOOK_EVERY_S: Final = 0.5
_LOOK_S: Final = 2.0
"""The scheduler answers within this time, or counts as lost."""
_WARM_UP_S: Final = 120.0
_END_S: Final = 8.0
_RETRY_S: Final = (1.0, 30.0)
"""First and longest wait before the cluster is tried again."""


class Cluster:
    """A connection to a cluster that is kept up in a thread of its own.

    Args:
        settings: with an address.
        processes: of the worker, where the address is "local".
        solvers: what workers import before they get work.
        functions: likewise; importable.

    Raises:
        InputError: a TLS file cannot be used, or the extra is not installed.
    """

    def __init__(
        self,
        settings: ClusterSettings,
        processes: int,
        solvers: Sequence[Any] = (),
        functions: Sequence[Callable[..., Any]] = (),
    ) -> None:
        self._settings = settings
        self._security = security_of(settings)
        self._own = WorkerExecutor(processes) if settings.address == LOCAL else None
        self._processes = processes
        self._warm_up_args = (tuple(solvers), *functions)
        self._number = itertools.count(1)
        self._client: Any = None
        self._arrays: SentArrays | None = None
        self._ready: dict[str, int] = {}
        self._asked: set[str] = set()
        self._refused: set[str] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._complained, self._wait_s = False, _RETRY_S[0]
        self._changed = threading.Condition()
        self._closing, self._closed = threading.Lock(), False
        self._loop = asyncio.new_event_loop()
        self._lost: asyncio.Future[str] = self._loop.create_future()
        self._thread = threading.Thread(target=self._run, name="cluster", daemon=True)
        self._thread.start()

    @property
    def slots(self) -> int:
        """Processes of the workers that are ready; 0 without a cluster."""
        return sum(self._ready.copy().values())

    def wait_for(self, slots: int, timeout_s: float) -> bool:
        """Wait until so many processes are ready; whether they are."""
        with self._changed:
            return self._changed.wait_for(lambda: self.slots >= slots, timeout_s)

    def submit(
        self, function: Callable[..., Any], args: Sequence[Any], timeout_s: float, within_s: float
    ) -> Future[Any]:
        """Call an importable function on a worker.

        Args:
            timeout_s: the process that runs it is killed then.
            within_s: how long the answer is awaited, a queue included.

        Returns:
            a future that ends within that time: with the value, `CallFailed`, `TimeoutError` (its
            process was killed), or `ClusterLost`.
        """
        return self._start(self._counted(ClusterCall(function, args, timeout_s, within_s)))

    def close(self) -> None:
        """Give up the connection; calls end with `ClusterLost`."""
        with self._closing:
            first, self._closed = not self._closed, True
        if first:
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_END_S + 2.0)
        if self._own is not None:
            self._own.shutdown()

    def _start(self, work: Coroutine[Any, Any, Any]) -> Future[Any]:
        # What is started before the loop is told to stop still ends.
        with self._closing:
            if not self._closed:
                return asyncio.run_coroutine_threadsafe(work, self._loop)
        work.close()
        refused: Future[Any] = Future()
        refused.set_exception(ClusterLost("the connection is closed"))
        return refused

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        keeper = self._loop.create_task(self._keep())
        try:
            self._loop.run_forever()
        finally:
            self._complained = True
            self._end("the connection is closed")
            keeper.cancel()
            left = [task for task in asyncio.all_tasks(self._loop) if task is not keeper]
            self._loop.run_until_complete(asyncio.wait([keeper, *left], timeout=_END_S))
            self._loop.close()

    async def _keep(self) -> None:
        while True:
            try:
                await self._keep_connected()
            except Exception as error:
                self._end(str(error) if isinstance(error, ClusterLost) else error_line(error))
            self._set_ready({})
            await asyncio.sleep(self._wait_s)
            self._wait_s = min(_RETRY_S[1], 2 * self._wait_s)

    async def _keep_connected(self) -> None:
        """One connection, from its beginning to its loss, of which it tells by raising."""
        async with connected(self._settings, self._security, self._own, self._processes) as client:
            self._client, self._arrays = client, SentArrays(client)
            self._wait_s = _RETRY_S[0]
            self._asked.clear()
            self._refused.clear()
            try:
                while client.status == "running":
                    found = await asyncio.wait_for(client.scheduler.identity(), _LOOK_S)
                    self._look({w: info["nthreads"] for w, info in found["workers"].items()})
                    await asyncio.sleep(_LOOK_EVERY_S)
            finally:
                self._client, self._arrays = None, None
        raise ClusterLost("the scheduler has closed the connection")

    def _look(self, present: dict[str, int]) -> None:
        """Note which workers are there; new ones are warmed up and get work after it."""
        gone = self._ready.keys() - present.keys()
        if gone:
            self._set_ready({w: n for w, n in self._ready.items() if w not in gone})
        if gone and not self._ready:
            self._end("its last worker is gone")
        self._asked &= present.keys()
        self._refused &= present.keys()
        for worker in present.keys() - self._asked - self._refused:
            self._asked.add(worker)
            task = self._loop.create_task(self._admit(worker, present[worker]))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _admit(self, worker: str, processes: int) -> None:
        call = ClusterCall(warm_up, self._warm_up_args, _WARM_UP_S, _WARM_UP_S, (worker,))
        answers = await asyncio.gather(
            *(self._answer(call) for _ in range(processes)), return_exceptions=True
        )
        refused = [a.reason for a in answers if isinstance(a, CallAnswer) and a.kind == "refused"]
        if refused:
            self._refused.add(worker)
            log.warning(
                "cluster: worker %s gets no work, it is %s, this is %s: install the same there",
                worker,
                refused[0],
                build(),
            )
        elif all(isinstance(a, CallAnswer) for a in answers) and worker in self._asked:
            self._set_ready({**self._ready, worker: processes})
        else:
            self._asked.discard(worker)

    def _set_ready(self, ready: dict[str, int]) -> None:
        if ready.keys() - self._ready.keys():
            self._complained = False
            log.info(
                "cluster %s: %d workers with %d processes",
                self._settings.address,
                len(ready),
                sum(ready.values()),
            )
        with self._changed:
            self._ready = ready
            self._changed.notify_all()
        metrics.CLUSTER_PROCESSES.set(sum(ready.values()))

    def _ask_anew(self) -> None:
        """All workers are asked again before they get work."""
        self._asked.clear()
        self._set_ready({})

    def _end(self, reason: str) -> None:
        """End all calls; said once until a worker is ready again."""
        if not self._complained:
            self._complained = True
            metrics.CLUSTER_OUTAGES.inc()
            log.warning(
                "cluster %s: %s; this machine solves until it is back",
                self._settings.address,
                reason,
            )
        before, self._lost = self._lost, self._loop.create_future()
        before.set_result(reason)

    async def _counted(self, call: ClusterCall) -> Any:
        try:
            answer = await self._answer(call)
        except ClusterLost:
            metrics.CLUSTER_CALLS.labels("lost").inc()
            raise
        metrics.CLUSTER_CALLS.labels(answer.kind).inc()
        return answer.result()

    async def _answer(self, call: ClusterCall) -> CallAnswer:
        """The answer of a worker.

        Raises:
            ClusterLost: there is none.
        """
        lost = self._lost
        asking = self._loop.create_task(self._ask(call))
        try:
            await asyncio.wait(
                (asking, lost), timeout=call.within_s, return_when=asyncio.FIRST_COMPLETED
            )
            if asking.done():
                return asking.result()
        except (concurrent.futures.CancelledError, asyncio.CancelledError) as error:
            # The connection is lost, or what a worker kept.
            self._ask_anew()
            raise ClusterLost(str(error) or "cancelled") from None
        except ClusterLost:
            raise
        except Exception as error:
            raise ClusterLost(error_line(error)) from None
        finally:
            asking.cancel()
        if lost.done():
            raise ClusterLost(lost.result())
        if not call.workers:
            # Somebody hangs.
            self._ask_anew()
            self._end(f"no answer within {call.within_s:.3g} s")
        raise ClusterLost("no answer in time")

    async def _ask(self, call: ClusterCall) -> CallAnswer:
        workers = call.workers or tuple(self._ready)
        if self._client is None or self._arrays is None or not workers:
            raise ClusterLost("no worker is ready")
        text, contents = write_call(call.function, call.args)
        client = self._client
        arrays, sent = await self._arrays.send(contents, workers)
        metrics.CLUSTER_BYTES.inc(len(text) + sent)
        future = client.submit(
            run_call,
            build(),
            text,
            arrays,
            call.timeout_s,
            key=f"slipstream-call-{id(self)}-{next(self._number)}",
            pure=False,
            workers=workers,
        )
        try:
            answer = await future
        finally:
            # A queued call of which nobody awaits the answer is not begun.
            future.release()
        if not isinstance(answer, CallAnswer):
            raise ClusterLost(f"answered with a {type(answer).__name__}")
        return answer

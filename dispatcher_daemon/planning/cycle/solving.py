"""What cycles are solved with: this machine's processes, and those of a cluster before them."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Self

from dispatcher_daemon.planning.routes import search_within
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers import Solver
from dispatcher_daemon.solvers.workers import Solve, SolverPool, WorkerExecutor

log = logging.getLogger(__name__)


class Solving:
    """What cycles solve with; a context manager.

    Args:
        in_routes: whether blocks of a city are solved in parallel.

    Attributes:
        slots: processes of the cluster that are ready; None: there is no cluster.
    """

    def __init__(
        self, settings: DispatcherSettings, solvers: Sequence[Solver], *, in_routes: bool
    ) -> None:
        self._settings, self._solvers = settings, solvers
        workers = settings.city.search.workers
        parallel = dict.fromkeys(settings.city.solvers, workers if in_routes else 1)
        self._pool, self._search = SolverPool(solvers, parallel), WorkerExecutor(workers)
        self.solve: Solve = self._pool
        self.executor: Executor = self._search
        self.slots: Callable[[], int] | None = None

    def warm_up(self, stopping: threading.Event) -> None:
        """Start this machine's processes, and import what they need."""
        faults = self._pool.warm_up(stopping=stopping)
        for name, reason in () if stopping.is_set() else faults.items():
            log.warning("solver %s is not ready: %s", name, reason)

    def join_cluster(self) -> None:
        """Have the settings' cluster solve first, if there is one."""
        if self._settings.cluster.address is None:
            return
        from dispatcher_daemon.solvers import cluster

        workers = self._settings.city.search.workers
        client = cluster.Cluster(self._settings.cluster, workers, self._solvers, (search_within,))
        self.solve = cluster.cluster_solve(client, self._solvers, self._pool)
        self.executor = cluster.ClusterExecutor(client, self._search, workers)
        self.slots = lambda: client.slots

    def fault(self) -> str | None:
        """Why no solver works, or no search for routes; None: they do, or a cluster does it all."""
        if self.slots is not None and self.slots() > 0:
            return None
        if (fault := self._pool.fault()) is not None:
            return f"no solver works ({fault})"
        fault = self._search.fault
        return None if fault is None else f"no search for routes works ({fault})"

    def ask_again(self) -> None:
        """See whether processes that died live again, where cycles have had nothing for them."""
        for workers in (self._pool, self._search):
            workers.ask_again(2 * self._settings.interval_s)

    def close(self) -> None:
        """Stop all processes at once, whatever they are doing."""
        self._pool.close()
        self.executor.shutdown()
        self._search.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

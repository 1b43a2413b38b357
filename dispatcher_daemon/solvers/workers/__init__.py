"""Where solvers run: worker processes under hard deadlines, any executor, or this process."""

from __future__ import annotations

from dispatcher_daemon.solvers.workers.executor import TimedExecutor, executor_solve
from dispatcher_daemon.solvers.workers.pool import (
    GRACE_S,
    RESERVE,
    PoolJob,
    Solve,
    SolverPool,
    error_line,
    solve_in_process,
    solving_s,
)
from dispatcher_daemon.solvers.workers.processes import (
    Processes,
    WorkerExecutor,
    start_fork_server,
)

__all__ = [
    "GRACE_S",
    "RESERVE",
    "PoolJob",
    "Processes",
    "Solve",
    "SolverPool",
    "TimedExecutor",
    "WorkerExecutor",
    "error_line",
    "executor_solve",
    "solve_in_process",
    "solving_s",
    "start_fork_server",
]

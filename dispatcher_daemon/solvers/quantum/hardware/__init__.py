"""A quantum device beside the dispatch cycle: asked by a thread and a process of its own, and never
waited for beyond the cycle's deadline.

- `manager`: `JobManager`, the `Solve` that the cycle calls
- `thread`: `JobThread`, the one thread that changes the ledger and calls the worker
- `runner`: `JobRunner`, submits, polls and delivers jobs, step by step
- `request`, `tracking`: a cycle's request for an answer; a job's state outside the ledger
- `ledger`, `breaker`: stored jobs and the device-time budget; the circuit breaker
- `service`, `circuits`: the worker process and its calls; building circuits, decoding samples
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from slipstream.on_demand import on_demand

if TYPE_CHECKING:
    from dispatcher_daemon.solvers.quantum.hardware.breaker import JobLimits
    from dispatcher_daemon.solvers.quantum.hardware.circuits import ChainCircuitBuilder
    from dispatcher_daemon.solvers.quantum.hardware.manager import JobManager, open_job_manager
    from dispatcher_daemon.solvers.quantum.hardware.service import ServiceFactory
    from dispatcher_daemon.solvers.quantum.hardware.thread import JobThread

__all__ = [
    "ChainCircuitBuilder",
    "JobLimits",
    "JobManager",
    "JobThread",
    "ServiceFactory",
    "open_job_manager",
]

# The worker process imports this package too; only the last module needs a database.
__getattr__ = on_demand(__name__, __all__, "breaker circuits service manager")

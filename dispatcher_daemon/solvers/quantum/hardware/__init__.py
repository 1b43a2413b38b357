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

from importlib import import_module
from typing import TYPE_CHECKING, Final

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


_MODULES: Final = "breaker circuits service manager"
"""Where the names are found, light modules first; only the last needs a database."""


def __getattr__(name: str) -> object:
    # Loaded on demand: the worker process imports this package too.
    for module in _MODULES.split() if name in __all__ else ():
        found = vars(import_module(f"{__name__}.{module}"))
        if name in found:
            return found[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""From the settings to a desk beside the solver pool, or to none."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dispatcher_daemon.hardware.chain_maker import ChainMaker
from dispatcher_daemon.hardware.clerk import Clerk
from dispatcher_daemon.hardware.desk import Desk
from dispatcher_daemon.hardware.ledger import DeviceKind, JobStore
from dispatcher_daemon.settings import GUEST_SOLVER, DispatcherSettings
from dispatcher_daemon.solvers.lc_qaoa import LcQaoaSolver
from dispatcher_daemon.solvers.pool import Solve
from dispatcher_daemon.solvers.quantum.backends.jobs import JobService
from dispatcher_daemon.solvers.registry import make_solver


@dataclass(frozen=True)
class Opening:
    """Opens the service of a device, in whatever process.

    Attributes:
        backend: as in `HardwareSettings.backend`.
    """

    backend: str

    @property
    def stale_s(self) -> float:
        """The least busy device is chosen anew; a name stays what it is."""
        from dispatcher_daemon.solvers.quantum.backends.ibm import CALIBRATION_S, LEAST_BUSY

        return CALIBRATION_S if self.backend == f"ibm:{LEAST_BUSY}" else math.inf

    def __call__(self) -> JobService:
        """See `Opener`."""
        from dispatcher_daemon.solvers.quantum.backends import open_service

        return open_service(self.backend)


def kind_of(backend: str) -> DeviceKind:
    """Whether it is a device, or a simulator that stands in for one."""
    return "hardware" if backend.startswith("ibm:") else "noise-model"


def open_desk(settings: DispatcherSettings, solve: Solve, store: JobStore) -> Desk | None:
    """The desk for the configured device; None where there is none.

    Args:
        solve: solver pool that the desk stands beside.
        store: of the ledger of jobs.

    Raises:
        StorageError: the ledger cannot be read.
    """
    hardware = settings.hardware
    if not hardware.backend:
        return None
    solver = make_solver(GUEST_SOLVER, settings)
    assert isinstance(solver, LcQaoaSolver)
    opening, kind = Opening(hardware.backend), kind_of(hardware.backend)
    clerk = Clerk(hardware, kind, opening, ChainMaker(solver), store)
    return Desk(solve, clerk, hardware.wait_s, settings.deadline_s)

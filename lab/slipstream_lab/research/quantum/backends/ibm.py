"""A device of IBM Quantum as a back end, for a caller that can wait."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dispatcher_daemon.solvers import BackendKind
from dispatcher_daemon.solvers.quantum.backends import (
    IbmService,
    JobView,
    Sampled,
    ServiceFault,
    fit,
    open_ibm,
    two_qubit_depth,
    two_qubit_gates,
)
from dispatcher_daemon.solvers.quantum.chain import QubitPlacement


@dataclass(frozen=True)
class IbmBackend:
    """A device as a `Backend`.

    Attributes:
        service: the device.
        poll_s: time between two looks.
    """

    service: IbmService
    poll_s: float = 2.0
    kind: BackendKind = "hardware"

    @property
    def name(self) -> str:
        """See `Backend.name`."""
        return f"ibm:{self.service.name}"

    @property
    def target(self) -> Any:
        """See `Backend.target`."""
        return self.service.target

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """See `Backend.place`."""
        return self.service.place(n, bond_weights)

    def sample(self, circuit: Any, shots: int, seed: int, wait_s: float = 900.0) -> Sampled:
        """See `Backend.sample`.

        Raises:
            ServiceFault: its line names the job.
        """
        began = time.perf_counter()
        transpiled = fit(circuit, self.target)
        job_id = self.service.submit_transpiled(transpiled, shots, ["slipstream"])
        late: ServiceFault | None = None
        try:
            view = self._wait(job_id, began, wait_s)
        except ServiceFault as fault:
            late = fault
        except BaseException:
            # Ctrl-C: the result is not needed any more, so the job is cancelled.
            self._cancelled(job_id)
            raise
        if late is not None:
            raise ServiceFault(late.kind, f"{late}{self._cancelled(job_id)}")
        if view.state != "done" or view.counts is None:
            raise ServiceFault("broken", f"job {job_id} {view.state}: {view.reason or 'no reason'}")
        return Sampled(
            counts=view.counts,
            backend=self.name,
            kind=self.kind,
            two_qubit_depth=two_qubit_depth(transpiled),
            two_qubit_gates=two_qubit_gates(transpiled),
            sample_s=time.perf_counter() - began,
            job=job_id,
        )

    def _wait(self, job_id: str, began: float, wait_s: float) -> JobView:
        """The job once it is over; passing faults are outwaited, others name the job."""
        line = f"job {job_id} was not done after {wait_s:g} s"
        while True:
            try:
                view = self.service.look(job_id)
                if view.state not in ("queued", "running"):
                    return view
            except ServiceFault as fault:
                line = f"job {job_id} not seen any more: {fault}"
                if fault.kind == "refused":
                    raise ServiceFault("refused", line) from None
            if time.perf_counter() + self.poll_s > began + wait_s:
                break
            time.sleep(self.poll_s)
        raise ServiceFault("unreachable", line)

    def _cancelled(self, job_id: str) -> str:
        """Cancel a job; what is to be said of it."""
        try:
            self.service.cancel(job_id)
        except ServiceFault as fault:
            return f"; it could not be cancelled: {fault}"
        return "; it is cancelled"


def open_ibm_backend(name: str) -> IbmBackend:
    """`open_ibm` as a `Backend`."""
    return IbmBackend(open_ibm(name))

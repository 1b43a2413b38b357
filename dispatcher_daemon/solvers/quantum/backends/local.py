"""A simulated device with the interface of a job service, for tests and trials without hardware.

Its samples come from the device's noise model, and their kind is never "hardware".
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count
from typing import Any

from dispatcher_daemon.solvers.quantum.backends.aer import NoisyBackend, fake_target
from dispatcher_daemon.solvers.quantum.backends.base import DeviceOnTarget, Sampled, device_s
from dispatcher_daemon.solvers.quantum.backends.jobs import JobView

KEPT = 100
"""Jobs that are over and still known, with their samples."""


@dataclass(frozen=True)
class _Job:
    tags: tuple[str, ...]
    future: Future[Sampled]
    charge_s: float


class LocalService(DeviceOnTarget):
    """A `JobService` whose jobs run one after another in a thread of this process.

    The last `KEPT` jobs are known, and those that are not over, as long as this object is; others
    are lost. Each is charged what `estimate_s` says.

    Args:
        device: class name in `qiskit_ibm_runtime.fake_provider`.
        seed: of the first job's samples; each further job has the next.

    Raises:
        InputError: there is no such device.
    """

    def __init__(self, device: str, seed: int = 1) -> None:
        self._backend = NoisyBackend(device)
        # Whether there is such a device.
        fake_target(device)
        self._seeds = count(seed)
        self._jobs: dict[str, _Job] = {}
        self._lock = threading.Lock()
        self._runner = ThreadPoolExecutor(1, thread_name_prefix="noise-model")

    @property
    def name(self) -> str:
        """Name of the fake device."""
        return self._backend.device

    @property
    def target(self) -> Any:
        """The fake device's target."""
        return self._backend.target

    def submit(self, circuit: Any, shots: int, tags: Sequence[str]) -> str:
        """See `JobService.submit`."""
        with self._lock:
            seed = next(self._seeds)
            # Never an id that an earlier process gave to another job.
            job_id = f"local-{secrets.token_hex(6)}"
            future = self._runner.submit(self._backend.sample, circuit, shots, seed)
            self._jobs[job_id] = _Job(tuple(tags), future, device_s(shots))
            over = [known for known, job in self._jobs.items() if job.future.done()]
            for known in over[: max(0, len(over) - KEPT)]:
                del self._jobs[known]
        return job_id

    def look(self, job_id: str, *, samples: bool = True) -> JobView:
        """See `JobService.look`."""
        job = self._jobs.get(job_id)
        if job is None:
            return JobView("lost")
        if job.future.cancelled():
            return JobView("cancelled", reason="cancelled on request", usage_s=0.0)
        if not job.future.done():
            return JobView("running" if job.future.running() else "queued")
        try:
            sampled = job.future.result()
        except CancelledError:
            return JobView("cancelled", reason="cancelled on request", usage_s=0.0)
        except Exception as error:
            return JobView("failed", reason=str(error), usage_s=0.0)
        return JobView("done", usage_s=job.charge_s, counts=sampled.counts if samples else None)

    def cancel(self, job_id: str) -> None:
        """See `JobService.cancel`; a job that is running is finished."""
        job = self._jobs.get(job_id)
        if job is not None:
            job.future.cancel()

    def find(self, tag: str) -> list[str]:
        """See `JobService.find`."""
        with self._lock:
            return [job_id for job_id, job in reversed(self._jobs.items()) if tag in job.tags]

    def close(self) -> None:
        """Cancel what waits and end the thread once the running job is over."""
        self._runner.shutdown(wait=True, cancel_futures=True)

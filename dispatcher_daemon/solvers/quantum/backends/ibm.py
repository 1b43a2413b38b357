"""Devices of IBM Quantum through qiskit-ibm-runtime's sampler."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from dispatcher_daemon.solvers.quantum.backends.base import DeviceOnTarget, device_s, fit
from dispatcher_daemon.solvers.quantum.backends.ibm_account import (
    AccountAccess,
    find_access,
    open_client,
)
from dispatcher_daemon.solvers.quantum.backends.ibm_faults import ask, without_secrets
from dispatcher_daemon.solvers.quantum.backends.jobs import JobState, JobView, ServiceFault
from slipstream.errors import InputError

LEAST_BUSY = "least-busy"
CALIBRATION_S = 3600.0
"""The device's calibration is read again when it is older."""
STATES: Mapping[str, JobState] = {
    "INITIALIZING": "queued",
    "QUEUED": "queued",
    "RUNNING": "running",
    "DONE": "done",
    "ERROR": "failed",
    "CANCELLED": "cancelled",
}


def open_ibm(name: str, access: AccountAccess | None = None) -> IbmService:
    """A device of the account.

    Args:
        name: of the device; "least-busy": the operational one with the shortest queue now.
        access: from the environment by default.

    Raises:
        InputError: there is no token, or no such device.
        ServiceFault: the service does not do what it is asked.
    """
    access = access or find_access()

    def connect() -> tuple[Any, Any]:
        # A client of its own: it keeps the list of devices, with their queues, that it began with.
        client = open_client(access)
        # The client hides why it got no list of devices; this call does not.
        client.usage()
        return client, _find_device(client, name)

    client, device = ask(access.token, connect)
    return IbmService(client, device, access.token)


def _find_device(client: Any, name: str) -> Any:
    from qiskit.providers.exceptions import QiskitBackendNotFoundError

    try:
        # None: with fractional gates where the device has them.
        if name == LEAST_BUSY:
            return client.least_busy(use_fractional_gates=None)
        return client.backend(name, use_fractional_gates=None)
    except QiskitBackendNotFoundError:
        listed = [str(d["name"]) for d in client._get_api_client().list_backends()]
        if name == LEAST_BUSY or name in listed:
            raise
    raise InputError(
        "backend",
        f"IBM Quantum offers this account no device {name!r}",
        f"use one of {', '.join(sorted(listed))}" if listed else "check the account's instance",
    )


class IbmService(DeviceOnTarget):
    """A device as a `JobService`.

    Args:
        client: `QiskitRuntimeService`.
        device: `IBMBackend` of it.
        token: to be left out of all lines.
    """

    def __init__(self, client: Any, device: Any, token: str) -> None:
        self._client = client
        self._device = device
        self._token = token
        self._calibrated = time.monotonic()

    def __repr__(self) -> str:
        return f"IbmService({self.name!r})"

    @property
    def name(self) -> str:
        """Name of the device."""
        return str(self._device.name)

    @property
    def target(self) -> Any:
        """The device's `qiskit.transpiler.Target`, its calibration at most `CALIBRATION_S` old."""

        def read() -> Any:
            if time.monotonic() - self._calibrated > CALIBRATION_S:
                self._device.refresh()
                self._calibrated = time.monotonic()
            return self._device.target

        return ask(self._token, read)

    def submit(self, circuit: Any, shots: int, tags: Sequence[str]) -> str:
        """See `JobService.submit`; the circuit is transpiled for the device.

        Twirling rounds the shots up to a multiple of its random frames.
        """
        return self.submit_transpiled(fit(circuit, self.target), shots, tags)

    def submit_transpiled(self, circuit: Any, shots: int, tags: Sequence[str]) -> str:
        """`submit` of a circuit in the device's gates."""

        def run() -> str:
            from qiskit_ibm_runtime.executor_sampler import Sampler

            # The client only warns, and such a job would wait for the next month.
            if self._client.usage().get("usage_limit_reached"):
                raise ServiceFault("limited", "IBM Quantum: the plan's device time is used up")
            sampler = Sampler(self._device, self._sampler_options(circuit, shots, tags))
            return str(sampler.run([circuit], shots=shots).job_id())

        return ask(self._token, run)

    def look(self, job_id: str, *, samples: bool = True) -> JobView:
        """See `JobService.look`."""
        return ask(self._token, lambda: self._view(job_id, samples=samples))

    def cancel(self, job_id: str) -> None:
        """See `JobService.cancel`."""

        def cancel() -> None:
            from qiskit_ibm_runtime.exceptions import RuntimeInvalidStateError, RuntimeJobNotFound

            try:
                self._client.job(job_id).cancel()
            except (RuntimeInvalidStateError, RuntimeJobNotFound):
                return

        ask(self._token, cancel)

    def find(self, tag: str) -> list[str]:
        """See `JobService.find`; up to 100 jobs."""
        return ask(
            self._token,
            lambda: [str(job.job_id()) for job in self._client.jobs(limit=100, job_tags=[tag])],
        )

    def _sampler_options(self, circuit: Any, shots: int, tags: Sequence[str]) -> dict[str, Any]:
        return {
            "max_execution_time": int(device_s(shots)),
            "dynamical_decoupling": {"enable": True, "sequence_type": "XpXm"},
            # No Pauli frame passes through fractional gates.
            "twirling": {
                "enable_gates": "rzz" not in circuit.count_ops(),
                "enable_measure": True,
            },
            "environment": {"job_tags": list(tags)},
        }

    def _view(self, job_id: str, *, samples: bool) -> JobView:
        from qiskit_ibm_runtime.exceptions import RuntimeJobNotFound

        try:
            job = self._client.job(job_id)
        except RuntimeJobNotFound:
            return JobView("lost")
        status = str(job.status())
        if status not in STATES:
            raise ServiceFault("garbage", f"IBM Quantum: a job's state is {status[:40]!r}")
        state = STATES[status]
        if state in ("queued", "running"):
            return JobView(state)
        usage = job.metrics().get("usage", {})
        used = usage.get("qpu_charge_time_seconds")
        usage_s = None if usage.get("status") == "pending" or used is None else float(used)
        if state == "done" and not samples:
            return JobView("done", usage_s=usage_s)
        if state == "done":
            # The job is over, so nothing is waited for.
            result = job.result(timeout=1.0)
            counts = result[0].join_data().get_counts()
            return JobView("done", usage_s=usage_s, counts={k: int(n) for k, n in counts.items()})
        reason = job.error_message() if state == "failed" else None
        line = without_secrets(str(reason or state), self._token)
        return JobView(state, reason=line, usage_s=usage_s)

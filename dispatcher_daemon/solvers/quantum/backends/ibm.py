"""Devices of IBM Quantum through qiskit-ibm-runtime's sampler."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dispatcher_daemon.solvers.protocol import BackendKind
from dispatcher_daemon.solvers.quantum.backends.base import Sampled, device_s, fit
from dispatcher_daemon.solvers.quantum.backends.ibm_account import (
    AccountAccess,
    find_access,
    open_client,
)
from dispatcher_daemon.solvers.quantum.backends.ibm_faults import ask, without_secrets
from dispatcher_daemon.solvers.quantum.backends.jobs import JobState, JobView, ServiceFault
from dispatcher_daemon.solvers.quantum.backends.targets import two_qubit_depth, two_qubit_gates
from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement, place_chain
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


@dataclass(frozen=True)
class IbmOptions:
    """What the sampler does about errors.

    Attributes:
        dynamical_decoupling: pulses on idle qubits.
        twirl_gates: random Pauli frames around two-qubit gates; only of circuits without
            fractional gates, which no Pauli frame passes through.
        twirl_measurement: random flips before measurement, taken back afterwards.
        fractional: use RZZ and RX where the device has them.
    """

    dynamical_decoupling: bool = True
    twirl_gates: bool = True
    twirl_measurement: bool = True
    fractional: bool = True


def open_ibm(
    name: str, options: IbmOptions | None = None, access: AccountAccess | None = None
) -> IbmService:
    """A device of the account.

    Args:
        name: of the device; "least-busy": the operational one with the shortest queue now.
        options: of the sampler.
        access: from the environment by default.

    Raises:
        InputError: there is no token, or no such device.
        ServiceFault: the service does not do what it is asked.
    """
    access = access or find_access()
    options = options or IbmOptions()

    def connect() -> tuple[Any, Any]:
        # A client of its own: it keeps the list of devices, with their queues, that it began with.
        client = open_client(access)
        # The client hides why it got no list of devices; this call does not.
        client.usage()
        return client, _find_device(client, name, options)

    client, device = ask(access.token, connect)
    return IbmService(client, device, options, access.token)


def _find_device(client: Any, name: str, options: IbmOptions) -> Any:
    from qiskit.providers.exceptions import QiskitBackendNotFoundError

    # None: with fractional gates where the device has them.
    fractional = None if options.fractional else False
    try:
        if name == LEAST_BUSY:
            return client.least_busy(use_fractional_gates=fractional)
        return client.backend(name, use_fractional_gates=fractional)
    except QiskitBackendNotFoundError:
        listed = [str(d["name"]) for d in client._get_api_client().list_backends()]
        if name == LEAST_BUSY or name in listed:
            raise
    raise InputError(
        "backend",
        f"IBM Quantum offers this account no device {name!r}",
        f"use one of {', '.join(sorted(listed))}" if listed else "check the account's instance",
    )


class IbmService:
    """A device as a `JobService`.

    Args:
        client: `QiskitRuntimeService`.
        device: `IBMBackend` of it.
        options: of the sampler.
        token: to be left out of all lines.
    """

    def __init__(self, client: Any, device: Any, options: IbmOptions, token: str) -> None:
        self._client = client
        self._device = device
        self._options = options
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

    def estimate_s(self, circuit: Any, shots: int) -> float:
        """See `JobService.estimate_s`; it is also the job's time limit at the service."""
        return device_s(shots)

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """See `Backend.place`."""
        return place_chain(self.target, n, bond_weights=bond_weights)

    def two_qubit(self, circuit: Any) -> tuple[int, int]:
        """Layers of two-qubit gates of a circuit as it will run, and their number."""
        transpiled = fit(circuit, self.target)
        return two_qubit_depth(transpiled), two_qubit_gates(transpiled)

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
        fractional = "rzz" in circuit.count_ops()
        return {
            "max_execution_time": int(device_s(shots)),
            "dynamical_decoupling": {
                "enable": self._options.dynamical_decoupling,
                "sequence_type": "XpXm",
            },
            "twirling": {
                "enable_gates": self._options.twirl_gates and not fractional,
                "enable_measure": self._options.twirl_measurement,
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


@dataclass(frozen=True)
class IbmBackend:
    """A device as a `Backend`, for a caller that can wait.

    Attributes:
        service: the device.
        wait_s: after that a job is cancelled.
        poll_s: time between two looks.
    """

    service: IbmService
    wait_s: float = 900.0
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

    def sample(self, circuit: Any, shots: int, seed: int) -> Sampled:
        """See `Backend.sample`; the line of a fault names the job."""
        began = time.perf_counter()
        transpiled = fit(circuit, self.target)
        job_id = self.service.submit_transpiled(transpiled, shots, ["slipstream"])
        late: ServiceFault | None = None
        try:
            view = self._wait(job_id, began + self.wait_s)
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
            two_qubit_depth=two_qubit_depth(transpiled),
            two_qubit_gates=two_qubit_gates(transpiled),
            sample_s=time.perf_counter() - began,
            job=job_id,
        )

    def _wait(self, job_id: str, until: float) -> JobView:
        """The job once it is over; passing faults are outwaited, others name the job."""
        line = f"job {job_id} was not done after {self.wait_s:g} s"
        while True:
            try:
                view = self.service.look(job_id)
                if view.state not in ("queued", "running"):
                    return view
            except ServiceFault as fault:
                line = f"job {job_id} not seen any more: {fault}"
                if fault.kind == "refused":
                    raise ServiceFault("refused", line) from None
            if time.perf_counter() + self.poll_s > until:
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

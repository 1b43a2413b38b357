"""What is tracked of a job: how it begins, its state outside the ledger, what a poll changes."""

from __future__ import annotations

import math
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, get_args

from dispatcher_daemon.settings import HardwareSettings
from dispatcher_daemon.solvers.protocol import Execution
from dispatcher_daemon.solvers.quantum.backends.jobs import (
    FaultKind,
    JobState,
    JobView,
    ServiceFault,
)
from dispatcher_daemon.solvers.quantum.hardware.circuits import check_samples
from dispatcher_daemon.solvers.quantum.hardware.ledger import DeviceKind
from dispatcher_daemon.solvers.quantum.hardware.request import JobRequest
from dispatcher_daemon.solvers.quantum.hardware.service import PreparedCircuit
from storage import QuantumJob

_NS: Final = 1e9
_STATES: Final = get_args(JobState)


@dataclass
class TrackedJob:
    """A job's state outside the ledger; lost at a restart.

    Attributes:
        next_poll_at: time of the next poll, by the monotonic clock, s.
        poll_period_s: from that poll to the one after it, s.
        unknown_since: first of the latest polls in a row at which the service did not know it.
        cancelled: its cancellation was requested.
        samples: of a job that is done, until they are decoded.
        requests: that wait for it.
    """

    next_poll_at: float
    poll_period_s: float
    unknown_since: float | None = None
    cancelled: bool = False
    samples: Mapping[str, int] | None = None
    requests: list[JobRequest] = field(default_factory=list)


@dataclass(frozen=True)
class JobUpdate:
    """What a poll changes.

    Attributes:
        job: in its new state.
        samples: of a job that is done, checked.
        fault: to be counted against the service: kind and line.
    """

    job: QuantumJob
    samples: Mapping[str, int] | None = None
    fault: tuple[FaultKind, str] | None = None


def new_job(
    request: JobRequest,
    prepared: PreparedCircuit,
    kind: DeviceKind,
    settings: HardwareSettings,
    now_ns: int,
) -> QuantumJob:
    """The job as it is stored before it is submitted, under a unique tag.

    Args:
        now_ns: UTC, ns.
    """
    built = prepared.built
    return QuantumJob(
        tag=f"slipstream-{request.cycle}-{secrets.token_hex(8)}",
        job_id=None,
        # The name of the least busy device is only known now.
        backend=f"{settings.backend.partition(':')[0]}:{prepared.backend}",
        kind=kind,
        cycle=request.cycle,
        submitted_ns=now_ns,
        updated_ns=now_ns,
        finished_ns=None,
        state="intent",
        reason=None,
        estimate_s=prepared.estimate_s,
        usage_s=None,
        shots=settings.shots,
        circuit=built.fingerprint,
        variables=request.problem_key,
        chain_order=built.order,
        variant=built.variant,
        layers=built.layers,
        two_qubit_depth=prepared.two_qubit_depth,
        two_qubit_gates=prepared.two_qubit_gates,
        train_s=built.train_s,
    )


def execution_of(job: QuantumJob) -> Execution:
    """Where and how the circuit of a job ran."""
    return Execution(
        backend=job.backend,
        kind=job.kind,
        variant=job.variant,
        layers=job.layers,
        two_qubit_depth=job.two_qubit_depth,
        two_qubit_gates=job.two_qubit_gates,
        train_s=job.train_s,
        sample_s=((job.finished_ns or job.submitted_ns) - job.submitted_ns) / _NS,
        job=job.job_id,
    )


def after_poll(
    job: QuantumJob, view: object, now_ns: int, lost: bool, *, samples: bool = True
) -> JobUpdate:
    """What a poll of a job changes.

    Args:
        view: the service's answer, of any type.
        now_ns: UTC, ns.
        lost: the service has not known the job for so long that it is given up.
        samples: whether they were asked for.

    Raises:
        ServiceFault: of kind "garbage": the answer has no state; the job is polled again.
    """
    if not isinstance(view, JobView) or view.state not in _STATES:
        raise ServiceFault("garbage", "the service told no state of the job")
    if view.state == "lost":
        return after_loss(job, now_ns) if lost and job.open else JobUpdate(job)
    if view.state in ("queued", "running"):
        # A finished job cannot queue again: that would free its charge.
        return JobUpdate(replace(job, state=view.state, updated_ns=now_ns) if job.open else job)
    usage_s = valid_usage_s(view.usage_s)
    if usage_s is None:
        usage_s = job.usage_s
    if not job.open:
        job = replace(job, usage_s=usage_s)
        if not samples or job.state != "done" or view.state != "done":
            return JobUpdate(job)
        try:
            return JobUpdate(job, _checked_samples(view, job))
        except ServiceFault as fault:
            line = f"garbage: {fault}"
            unfit = replace(job, answer="unfit", reason=line, updated_ns=now_ns)
            return JobUpdate(unfit, fault=("garbage", line))
    job = replace(job, usage_s=usage_s, updated_ns=now_ns, finished_ns=now_ns)
    if view.state == "done":
        try:
            counts = _checked_samples(view, job)
        except ServiceFault as fault:
            line = f"garbage: {fault}"
            return JobUpdate(replace(job, state="failed", reason=line), fault=("garbage", line))
        return JobUpdate(replace(job, state="done", reason=None), counts)
    reason = one_line(view.reason) or job.reason
    if view.state == "cancelled":
        reason = reason or "cancelled at the service"
        return JobUpdate(replace(job, state="cancelled", reason=reason))
    line = reason or "failed at the service"
    failed = replace(job, state="failed", reason=line)
    return JobUpdate(failed, fault=("broken", f"job failed: {line}"))


def _checked_samples(view: JobView, job: QuantumJob) -> Mapping[str, int]:
    if view.counts is None:
        raise ServiceFault("garbage", "done, but without samples")
    check_samples(view.counts, len(job.chain_order), job.shots)
    return view.counts


def after_loss(job: QuantumJob, now_ns: int) -> JobUpdate:
    """Give up a job that the service does not know; its estimate stays reserved.

    One without an id was counted as a fault when it was submitted.
    """
    line = job.reason or "the service does not know it"
    lost = replace(job, state="lost", reason=line, updated_ns=now_ns, finished_ns=now_ns)
    return JobUpdate(lost, fault=None if job.job_id is None else ("broken", "a job was lost"))


def valid_usage_s(usage: object) -> float | None:
    """A charge if it is a finite time of at least 0 s; None for anything else."""
    if isinstance(usage, bool) or not isinstance(usage, int | float):
        return None
    return float(usage) if math.isfinite(usage) and usage >= 0 else None


def one_line(text: object) -> str:
    """Text from outside as one line of at most 200 characters."""
    return " ".join(str(text).split())[:200] if text else ""

"""What follows for a job from what the service says of it; pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import get_args

from dispatcher_daemon.hardware.making import check_samples
from dispatcher_daemon.solvers.quantum.backends.jobs import (
    FaultKind,
    JobState,
    JobView,
    ServiceFault,
)
from storage import QuantumJob

_STATES = get_args(JobState)


@dataclass(frozen=True)
class News:
    """A job after a look at it.

    Attributes:
        job: with what is new.
        samples: of a job that is done, checked.
        fault: what counts against the service.
    """

    job: QuantumJob
    samples: Mapping[str, int] | None = None
    fault: tuple[FaultKind, str] | None = None


def after_look(
    job: QuantumJob, view: object, now_ns: int, lost: bool, *, samples: bool = True
) -> News:
    """What a look at a job has shown.

    Args:
        view: what the service answered, whatever it is.
        now_ns: UTC.
        lost: the service has not known it for so long that it is given up.
        samples: whether they were asked for.

    Raises:
        ServiceFault: of kind "garbage": not even a state; it will be looked at again.
    """
    if not isinstance(view, JobView) or view.state not in _STATES:
        raise ServiceFault("garbage", "the service told no state of the job")
    if view.state == "lost":
        return after_loss(job, now_ns) if lost and job.open else News(job)
    if view.state in ("queued", "running"):
        # One that was over cannot queue again: that would free what it has cost.
        return News(replace(job, state=view.state, updated_ns=now_ns) if job.open else job)
    usage_s = known_usage_s(view.usage_s)
    if usage_s is None:
        usage_s = job.usage_s
    if not job.open:
        job = replace(job, usage_s=usage_s)
        if not samples or job.state != "done" or view.state != "done":
            return News(job)
        try:
            return News(job, _checked(view, job))
        except ServiceFault as fault:
            line = f"garbage: {fault}"
            unfit = replace(job, answer="unfit", reason=line, updated_ns=now_ns)
            return News(unfit, fault=("garbage", line))
    job = replace(job, usage_s=usage_s, updated_ns=now_ns, finished_ns=now_ns)
    if view.state == "done":
        try:
            counts = _checked(view, job)
        except ServiceFault as fault:
            line = f"garbage: {fault}"
            return News(replace(job, state="failed", reason=line), fault=("garbage", line))
        return News(replace(job, state="done", reason=None), counts)
    reason = one_line(view.reason) or job.reason
    if view.state == "cancelled":
        return News(replace(job, state="cancelled", reason=reason or "cancelled at the service"))
    line = reason or "failed at the service"
    return News(replace(job, state="failed", reason=line), fault=("broken", f"job failed: {line}"))


def _checked(view: JobView, job: QuantumJob) -> Mapping[str, int]:
    if view.counts is None:
        raise ServiceFault("garbage", "done, but without samples")
    check_samples(view.counts, len(job.chain_order), job.shots)
    return view.counts


def after_loss(job: QuantumJob, now_ns: int) -> News:
    """A job that the service does not know, given up; what was reserved for it stays reserved.

    One whose id never came was counted as a fault when it was submitted.
    """
    line = job.reason or "the service does not know it"
    lost = replace(job, state="lost", reason=line, updated_ns=now_ns, finished_ns=now_ns)
    return News(lost, fault=None if job.job_id is None else ("broken", "a job was lost"))


def known_usage_s(usage: object) -> float | None:
    """A charge as it can be believed: a time; None for anything else."""
    if isinstance(usage, bool) or not isinstance(usage, int | float):
        return None
    return float(usage) if math.isfinite(usage) and usage >= 0 else None


def one_line(text: object) -> str:
    """Foreign words as one line of at most 200 characters."""
    return " ".join(str(text).split())[:200] if text else ""

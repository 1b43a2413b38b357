"""The job runner: one device's jobs, from before they are submitted until all of them is known.

Without a thread of its own: each call does one step and returns. Faults of the service are
recorded, counted and given to the waiting requests as the reason; they are not raised.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from dispatcher_daemon import metrics
from dispatcher_daemon.settings import HardwareSettings
from dispatcher_daemon.solvers.quantum.backends.jobs import FaultKind, ServiceFault
from dispatcher_daemon.solvers.quantum.hardware import service
from dispatcher_daemon.solvers.quantum.hardware.breaker import CircuitBreaker, JobLimits
from dispatcher_daemon.solvers.quantum.hardware.circuits import ChainCircuitBuilder, Unsuitable
from dispatcher_daemon.solvers.quantum.hardware.ledger import DeviceKind, Ledger, budget_refusal
from dispatcher_daemon.solvers.quantum.hardware.request import JobRequest
from dispatcher_daemon.solvers.quantum.hardware.service import (
    PreparedCircuit,
    ServiceFactory,
)
from dispatcher_daemon.solvers.quantum.hardware.tracking import (
    JobUpdate,
    TrackedJob,
    after_loss,
    after_poll,
    execution_of,
    new_job,
    one_line,
)
from dispatcher_daemon.solvers.workers.pool import error_line
from slipstream.service import LogLimiter
from storage import QuantumJob, StorageError

log = logging.getLogger(__name__)

_POLL_GROWTH: Final = 1.5
_CHARGE_POLL_S: Final = 3600.0
_NS: Final = 1e9


class JobRunner:
    """Submits, polls and cancels the jobs of one device; used by one thread.

    Args:
        factory, builder: used in the worker.
        call: runs a call in the worker, see `ServiceWorker.call`.
        clock_ns: UTC, ns (`MonotonicUtcClock`).
        clock: monotonic time, s.
    """

    def __init__(
        self,
        settings: HardwareSettings,
        limits: JobLimits,
        kind: DeviceKind,
        factory: ServiceFactory,
        builder: ChainCircuitBuilder,
        ledger: Ledger,
        breaker: CircuitBreaker,
        call: Callable[..., Any],
        clock_ns: Callable[[], int],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._settings, self._limits, self._kind = settings, limits, kind
        self._factory, self._builder = factory, builder
        self._ledger, self._breaker = ledger, breaker
        self._call, self._clock_ns, self._clock = call, clock_ns, clock
        self._limiter = LogLimiter()
        self._tracked = {job.tag: self._new_tracked() for job in ledger.jobs()}
        self._left_in_cycle = settings.jobs_per_cycle
        self._min_estimate_s: float | None = None

    def begin_cycle(self) -> None:
        """A new cycle may submit jobs again."""
        self._left_in_cycle = self._settings.jobs_per_cycle

    def refusal(self) -> str | None:
        """Why no job would be submitted now, not even the cheapest so far; None if one would."""
        limits = self._settings
        line = self._breaker.refusal()
        if line is None and len(self._ledger.pending()) >= limits.max_pending_jobs:
            line = f"{limits.max_pending_jobs} jobs are pending already"
        if line is None:
            estimate_s, used_s = self._min_estimate_s or 0.0, self._ledger.used_s()
            line = budget_refusal(used_s, estimate_s, limits.budget_s_per_day)
        return line

    def serve(self, request: JobRequest) -> None:
        """Assign a request to a job with the same problem key, or submit a new job for it."""
        if not request.open:
            return
        known = [
            job
            for job in self._ledger.jobs()
            if job.variables == request.problem_key and (job.open or self._is_unread(job))
        ]
        if known:
            job = max(known, key=lambda job: (not job.open, job.submitted_ns))
            tracked = self._tracked[job.tag]
            tracked.requests.append(request)
            self._report_state(job)
            if tracked.samples is not None:
                self._deliver(job)
            else:
                tracked.next_poll_at = self._clock()
            return
        refusal = self.refusal()
        if refusal is None and self._left_in_cycle < 1:
            refusal = f"no more than {self._settings.jobs_per_cycle} jobs a cycle"
        if refusal is not None:
            request.decline(refusal)
            return
        request.set_status("the circuit was still being prepared")
        prepared = self._prepared(request)
        if prepared is not None:
            self._submit(request, prepared)

    def _prepared(self, request: JobRequest) -> PreparedCircuit | None:
        limits = self._settings
        deadline_s = max(0.0, request.ends_at - self._clock())
        problem, seed = request.problem, request.seed
        args = (self._factory, self._builder, problem, deadline_s, seed, limits.shots)
        try:
            prepared: PreparedCircuit = self._call(
                service.prepare, args, deadline_s + self._limits.call_timeout_s
            )
        except ServiceFault as fault:
            request.decline(self._fault("not prepared", fault))
            return None
        except Unsuitable as error:
            request.decline(str(error))
            return None
        used_s, estimate_s = self._ledger.used_s(), prepared.estimate_s
        if self._min_estimate_s is None or estimate_s < self._min_estimate_s:
            self._min_estimate_s = estimate_s
        line = budget_refusal(used_s, estimate_s, limits.budget_s_per_day)
        if line is not None:
            request.decline(line)
            return None
        return prepared

    def _submit(self, request: JobRequest, prepared: PreparedCircuit) -> None:
        job = new_job(request, prepared, self._kind, self._settings, self._clock_ns())
        try:
            self._ledger.begin(job)
        except Exception as error:
            line = str(error) if isinstance(error, StorageError) else error_line(error)
            request.decline(f"no job, as it could not be stored: {line}")
            return
        self._left_in_cycle -= 1
        self._breaker.submitting()
        tracked = self._tracked[job.tag] = self._new_tracked()
        tracked.requests.append(request)
        request.set_status("the job was still being submitted")
        args = (self._factory, prepared.built.circuit, job.shots, job.tag)
        try:
            job_id = self._call(service.submit, args, self._limits.call_timeout_s)
            if not isinstance(job_id, str) or not job_id:
                raise ServiceFault("garbage", "the service told no id of the job")
        except ServiceFault as fault:
            line = self._fault("not submitted", fault)
            if fault.kind in ("refused", "limited"):
                # Refused before anything was done: the only faults after which there is no job.
                self._not_submitted(job, line)
                request.decline(line)
            else:
                # The service may have the job all the same; it is searched by its tag.
                self._ledger.update(replace(job, reason=line))
                request.set_status(line, timed=False)
            tracked.next_poll_at = self._clock() + tracked.poll_period_s
            return
        except Unsuitable as error:
            self._breaker.withdrawn()
            self._not_submitted(job, str(error))
            request.decline(str(error))
            return
        except BaseException:
            self._breaker.withdrawn()
            raise
        self._breaker.accepted()
        job = replace(job, job_id=job_id, state="queued", updated_ns=self._clock_ns())
        self._ledger.update(job)
        self._report_state(job)
        tracked.next_poll_at = self._clock() + tracked.poll_period_s

    def _not_submitted(self, job: QuantumJob, line: str) -> None:
        now_ns = self._clock_ns()
        over = replace(job, state="failed", reason=line, usage_s=0.0, finished_ns=now_ns)
        self._ledger.update(replace(over, updated_ns=now_ns))

    def next_poll(self) -> tuple[float, str] | None:
        """(time by the clock, tag) of the next poll; None if no job needs one."""
        due = [
            (self._tracked[job.tag].next_poll_at, job.tag)
            for job in self._ledger.jobs()
            if self._needs_polling(job)
        ]
        return min(due, default=None)

    def _needs_polling(self, job: QuantumJob) -> bool:
        unread = self._is_unread(job) and self._tracked[job.tag].samples is None
        return job.open or unread or (job.usage_s is None and job.job_id is not None)

    def _is_unread(self, job: QuantumJob) -> bool:
        return job.state == "done" and job.answer is None

    def poll(self, tag: str) -> None:
        """Poll a job once, and do what follows from its state."""
        tracked, job, limits = self._tracked[tag], self._ledger[tag], self._limits
        samples = job.open or (self._is_unread(job) and tracked.samples is None)
        tracked.next_poll_at = self._clock() + tracked.poll_period_s
        # Where only the charge is not known yet, no request waits for it.
        max_poll_s = limits.max_poll_s if samples else max(limits.max_poll_s, _CHARGE_POLL_S)
        tracked.poll_period_s = min(_POLL_GROWTH * tracked.poll_period_s, max_poll_s)
        age_s = (self._clock_ns() - job.submitted_ns) / _NS
        try:
            if job.job_id is None:
                self._find(job, tracked)
                return
            if job.open and age_s > limits.job_timeout_s and not tracked.cancelled:
                self._call(service.cancel, (self._factory, job.job_id), limits.call_timeout_s)
                tracked.cancelled = True
                line = f"no answer within {age_s:.0f} s"
                job = replace(job, reason=f"cancelled: {line}")
                # A device with a queue that long serves no cycle.
                self._count("unreachable", f"job {job.job_id}: {line}")
            args = (self._factory, job.job_id, samples)
            view = self._call(service.look, args, limits.call_timeout_s)
            lost = self._is_lost(tracked, getattr(view, "state", None) == "lost")
            update = after_poll(job, view, self._clock_ns(), lost, samples=samples)
        except ServiceFault as fault:
            line = self._fault("no news of a job", fault)
            if not (job.open and age_s > limits.job_timeout_s + limits.lost_after_s):
                return
            update = after_loss(replace(job, reason=line), self._clock_ns())
        self._apply(update)

    def _find(self, job: QuantumJob, tracked: TrackedJob) -> None:
        """Search for a job whose id never came."""
        args = (self._factory, job.tag)
        found = self._call(service.find, args, self._limits.call_timeout_s)
        ids = [job_id for job_id in found if isinstance(job_id, str) and job_id]
        if ids:
            tracked.unknown_since, tracked.next_poll_at = None, self._clock()
            found_job = replace(job, job_id=ids[0], state="queued", updated_ns=self._clock_ns())
            self._ledger.update(found_job)
            self._report_state(found_job)
        elif self._is_lost(tracked, True):
            self._apply(after_loss(job, self._clock_ns()))

    def _is_lost(self, tracked: TrackedJob, unknown: bool) -> bool:
        if not unknown:
            tracked.unknown_since = None
            return False
        if tracked.unknown_since is None:
            tracked.unknown_since = self._clock()
        return self._clock() - tracked.unknown_since >= self._limits.lost_after_s

    def _apply(self, update: JobUpdate) -> None:
        job, tracked = update.job, self._tracked[update.job.tag]
        was_open = self._ledger[job.tag].open
        if job != self._ledger[job.tag]:
            self._ledger.update(job)
        if update.fault is not None:
            self._count(*update.fault)
        if job.open:
            self._report_state(job)
            return
        if update.samples is not None and job.answer is None:
            if was_open:
                self._breaker.answered()
            tracked.samples = update.samples
            self._deliver(job)
        elif was_open or (job.answer is not None and tracked.samples is None):
            for request in tracked.requests:
                request.decline(f"job {job.job_id or job.tag} {job.state}: {job.reason}")
            tracked.requests.clear()

    def _deliver(self, job: QuantumJob) -> None:
        """Answer the first request that still waits with the decoded samples."""
        tracked = self._tracked[job.tag]
        while tracked.requests and tracked.samples is not None:
            request = tracked.requests.pop(0)
            if not request.open:
                continue
            request.set_status(f"the samples of job {job.job_id} were still being read")
            args = (request.problem, job.chain_order, tracked.samples, request.seed)
            line = None
            try:
                outcome = self._call(self._builder.decode, args, self._limits.call_timeout_s)
                if outcome.selected is None:
                    line = f"job {job.job_id}: {outcome.reason}"
            except ServiceFault as fault:
                # A fault of our own, not the service's.
                line = f"the samples of job {job.job_id} could not be read: {fault}"
            if line is None and not request.answer(replace(outcome, execution=execution_of(job))):
                continue
            if line is not None:
                request.decline(line)
            tracked.samples = None
            self._ledger.update(
                replace(
                    self._ledger[job.tag],
                    answer="used" if line is None else "unfit",
                    answer_cycle=request.cycle,
                    updated_ns=self._clock_ns(),
                )
            )
        if tracked.samples is None:
            for request in tracked.requests:
                request.decline(f"the samples of job {job.job_id} went to another block")
            tracked.requests.clear()

    def tidy(self) -> None:
        """Store what could not be stored; drop closed requests, late answers and old jobs."""
        self._ledger.flush()
        now_ns = self._clock_ns()
        for job in self._ledger.jobs():
            tracked = self._tracked[job.tag]
            tracked.requests = [request for request in tracked.requests if request.open]
            age_s = (now_ns - (job.finished_ns or now_ns)) / _NS
            if self._is_unread(job) and age_s > self._limits.job_timeout_s:
                tracked.samples = None
                self._ledger.update(replace(job, answer="late", updated_ns=now_ns))
        for tag in self._ledger.forget():
            del self._tracked[tag]

    def _new_tracked(self) -> TrackedJob:
        return TrackedJob(self._clock(), self._limits.poll_s)

    def _report_state(self, job: QuantumJob) -> None:
        since = self._clock() - (self._clock_ns() - job.submitted_ns) / _NS
        for request in self._tracked[job.tag].requests:
            request.set_status(f"job {job.job_id or job.tag} still {job.state}", since)

    def _fault(self, what: str, fault: ServiceFault) -> str:
        line = f"{what}: {one_line(fault)}"
        self._count(fault.kind, line, fault.retry_s)
        return line

    def _count(self, kind: FaultKind, line: str, retry_s: float | None = None) -> None:
        self._breaker.fault(kind, line, retry_s)
        metrics.QUANTUM_FAULTS.labels(kind).inc()
        if self._limiter.allow(kind):
            held = self._limiter.suppressed(kind)
            more = f" ({held} more of this kind)" if held else ""
            log.warning("quantum device: %s%s", line, more)

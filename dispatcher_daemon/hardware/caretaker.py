"""One device's jobs, from before they are submitted until nothing more is to be known of them.

Without a thread of its own: each call does one step and returns. Faults of the service never
leave it; they are written down, counted, and told to whoever waits.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, Protocol, TypeVar

from dispatcher_daemon import metrics
from dispatcher_daemon.hardware import budget, calls
from dispatcher_daemon.hardware.breaker import Breaker
from dispatcher_daemon.hardware.calls import Opener, Prepared
from dispatcher_daemon.hardware.care import Care, execution_of, intent
from dispatcher_daemon.hardware.follow import News, after_look, after_loss, one_line
from dispatcher_daemon.hardware.ledger import DeviceKind, Ledger
from dispatcher_daemon.hardware.making import Maker, Unsuitable
from dispatcher_daemon.hardware.ticket import Ticket
from dispatcher_daemon.settings import HardwareSettings
from dispatcher_daemon.solvers.pool import error_line
from dispatcher_daemon.solvers.quantum.backends.jobs import ServiceFault
from slipstream.service import LogLimiter
from storage import QuantumJob, StorageError

log = logging.getLogger(__name__)

T = TypeVar("T")
_SLOWER: Final = 1.5
_CHARGE_POLL_S: Final = 3600.0
_NS: Final = 1e9


class Call(Protocol):
    """Runs a call in the device's worker process (`GuestWorker.call`)."""

    def __call__(self, function: Callable[..., T], args: Sequence[Any], limit_s: float) -> T:
        """May raise ServiceFault, or WorkerClosed when all is to end."""
        ...


class Caretaker:
    """Looks after the jobs of one device; used by one thread.

    Args:
        settings: of the device.
        kind: of the device.
        opener: opens the service, in the worker.
        maker: makes circuits and reads samples, there too.
        ledger: of its jobs.
        breaker: of its faults.
        call: runs a call in the worker.
        clock_ns: UTC, at an even pace (`SteadyClock`).
        clock: seconds, monotonic.
    """

    def __init__(
        self,
        settings: HardwareSettings,
        kind: DeviceKind,
        opener: Opener,
        maker: Maker,
        ledger: Ledger,
        breaker: Breaker,
        call: Call,
        clock_ns: Callable[[], int],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._settings, self._kind = settings, kind
        self._opener, self._maker = opener, maker
        self._ledger, self._breaker = ledger, breaker
        self._call, self._clock_ns, self._clock = call, clock_ns, clock
        self._limiter = LogLimiter()
        self._care = {job.tag: self._begun() for job in ledger.jobs()}
        self._left_in_cycle = settings.jobs_per_cycle
        self._least_estimate_s: float | None = None

    def begin_cycle(self) -> None:
        """A new cycle may submit jobs again."""
        self._left_in_cycle = self._settings.jobs_per_cycle

    def refusal(self) -> str | None:
        """Why no job would be submitted now, not even the cheapest so far; None if one would."""
        limits = self._settings
        said = self._breaker.refusal()
        if said is None and len(self._ledger.pending()) >= limits.most_pending:
            said = f"{limits.most_pending} jobs are pending already"
        if said is None:
            least_s, used_s = self._least_estimate_s or 0.0, self._ledger.used_s()
            said = budget.refusal(used_s, least_s, limits.budget_s_per_day)
        return said

    def serve(self, ticket: Ticket) -> None:
        """Find an answer to a problem: from a job that is out already, or from a new one."""
        if not ticket.open:
            return
        known = [
            job
            for job in self._ledger.jobs()
            if job.variables == ticket.meaning and (job.open or self._is_unread(job))
        ]
        if known:
            job = max(known, key=lambda job: (not job.open, job.submitted_ns))
            care = self._care[job.tag]
            care.tickets.append(ticket)
            self._tell(job)
            if care.samples is not None:
                self._hand_out(job)
            else:
                care.next_at = self._clock()
            return
        refusal = self.refusal()
        if refusal is None and self._left_in_cycle < 1:
            refusal = f"no more than {self._settings.jobs_per_cycle} jobs a cycle"
        if refusal is not None:
            ticket.decline(refusal)
            return
        ticket.stage("the circuit was still being prepared")
        prepared = self._prepared(ticket)
        if prepared is not None:
            self._submit(ticket, prepared)

    def _prepared(self, ticket: Ticket) -> Prepared | None:
        limits = self._settings
        deadline_s = max(0.0, ticket.ends - self._clock())
        problem, seed = ticket.problem, ticket.seed
        args = (self._opener, self._maker, problem, deadline_s, seed, limits.shots)
        try:
            prepared = self._call(calls.prepare, args, deadline_s + limits.call_limit_s)
        except ServiceFault as fault:
            ticket.decline(self._fault("not prepared", fault))
            return None
        except Unsuitable as error:
            ticket.decline(str(error))
            return None
        used_s, estimate_s = self._ledger.used_s(), prepared.estimate_s
        if self._least_estimate_s is None or estimate_s < self._least_estimate_s:
            self._least_estimate_s = estimate_s
        said = budget.refusal(used_s, estimate_s, limits.budget_s_per_day)
        if said is not None:
            ticket.decline(said)
            return None
        return prepared

    def _submit(self, ticket: Ticket, prepared: Prepared) -> None:
        job = intent(ticket, prepared, self._kind, self._settings, self._clock_ns())
        try:
            self._ledger.begin(job)
        except Exception as error:
            line = str(error) if isinstance(error, StorageError) else error_line(error)
            ticket.decline(f"no job, as it could not be stored: {line}")
            return
        self._left_in_cycle -= 1
        self._breaker.submitting()
        care = self._care[job.tag] = self._begun()
        care.tickets.append(ticket)
        ticket.stage("the job was still being submitted")
        args = (self._opener, prepared.circuit, job.shots, job.tag)
        try:
            job_id = self._call(calls.submit, args, self._settings.call_limit_s)
            if not isinstance(job_id, str) or not job_id:
                raise ServiceFault("garbage", "the service told no id of the job")
        except ServiceFault as fault:
            line = self._fault("not submitted", fault)
            if fault.kind in ("refused", "limited"):
                # Said before anything was done: the only faults after which there is no job.
                self._never_was(job, line)
                ticket.decline(line)
            else:
                # It may be there all the same, to be found by its tag.
                self._ledger.update(replace(job, reason=line))
                ticket.stage(line, timed=False)
            care.next_at = self._clock() + care.period_s
            return
        except Unsuitable as error:
            self._breaker.withdrawn()
            self._never_was(job, str(error))
            ticket.decline(str(error))
            return
        except BaseException:
            self._breaker.withdrawn()
            raise
        self._breaker.submitted()
        job = replace(job, job_id=job_id, state="queued", updated_ns=self._clock_ns())
        self._ledger.update(job)
        self._tell(job)
        care.next_at = self._clock() + care.period_s

    def _never_was(self, job: QuantumJob, line: str) -> None:
        now_ns = self._clock_ns()
        over = replace(job, state="failed", reason=line, usage_s=0.0, finished_ns=now_ns)
        self._ledger.update(replace(over, updated_ns=now_ns))

    def next_look(self) -> tuple[float, str] | None:
        """(when by the clock, tag) of the job to look at next; None if there is none."""
        due = [
            (self._care[job.tag].next_at, job.tag)
            for job in self._ledger.jobs()
            if self._needs_looks(job)
        ]
        return min(due, default=None)

    def _needs_looks(self, job: QuantumJob) -> bool:
        unread = self._is_unread(job) and self._care[job.tag].samples is None
        return job.open or unread or (job.usage_s is None and job.job_id is not None)

    def _is_unread(self, job: QuantumJob) -> bool:
        return job.state == "done" and job.answer is None

    def look_after(self, tag: str) -> None:
        """One look at a job, and what follows from it."""
        care, job, limits = self._care[tag], self._ledger[tag], self._settings
        samples = job.open or (self._is_unread(job) and care.samples is None)
        care.next_at = self._clock() + care.period_s
        # Only the charge is not known yet: nobody waits for that.
        slowest_s = limits.most_poll_s if samples else max(limits.most_poll_s, _CHARGE_POLL_S)
        care.period_s = min(_SLOWER * care.period_s, slowest_s)
        age_s = (self._clock_ns() - job.submitted_ns) / _NS
        try:
            if job.job_id is None:
                self._find(job, care)
                return
            if job.open and age_s > limits.give_up_after_s and not care.cancelled:
                self._call(calls.cancel, (self._opener, job.job_id), limits.call_limit_s)
                care.cancelled = True
                line = f"no answer within {age_s:.0f} s"
                job = replace(job, reason=f"cancelled: {line}")
                # A device with a queue that long serves no cycle.
                self._count("unreachable", f"job {job.job_id}: {line}")
            args = (self._opener, job.job_id, samples)
            view = self._call(calls.look, args, limits.call_limit_s)
            lost = self._is_lost(care, getattr(view, "state", None) == "lost")
            news = after_look(job, view, self._clock_ns(), lost, samples=samples)
        except ServiceFault as fault:
            line = self._fault("no news of a job", fault)
            if not (job.open and age_s > limits.give_up_after_s + limits.lost_after_s):
                return
            news = after_loss(replace(job, reason=line), self._clock_ns())
        self._take_in(news)

    def _find(self, job: QuantumJob, care: Care) -> None:
        """Look for a job whose id never came."""
        args = (self._opener, job.tag)
        found = self._call(calls.find, args, self._settings.call_limit_s)
        ids = [job_id for job_id in found if isinstance(job_id, str) and job_id]
        if ids:
            care.unknown_since, care.next_at = None, self._clock()
            found_job = replace(job, job_id=ids[0], state="queued", updated_ns=self._clock_ns())
            self._ledger.update(found_job)
            self._tell(found_job)
        elif self._is_lost(care, True):
            self._take_in(after_loss(job, self._clock_ns()))

    def _is_lost(self, care: Care, unknown: bool) -> bool:
        if not unknown:
            care.unknown_since = None
            return False
        if care.unknown_since is None:
            care.unknown_since = self._clock()
        return self._clock() - care.unknown_since >= self._settings.lost_after_s

    def _take_in(self, news: News) -> None:
        job, care = news.job, self._care[news.job.tag]
        was_open = self._ledger[job.tag].open
        if job != self._ledger[job.tag]:
            self._ledger.update(job)
        if news.fault is not None:
            self._count(*news.fault)
        if job.open:
            self._tell(job)
            return
        if news.samples is not None and job.answer is None:
            if was_open:
                self._breaker.answered()
            care.samples = news.samples
            self._hand_out(job)
        elif was_open or (job.answer is not None and care.samples is None):
            for ticket in care.tickets:
                ticket.decline(f"job {job.job_id or job.tag} {job.state}: {job.reason}")
            care.tickets.clear()

    def _hand_out(self, job: QuantumJob) -> None:
        """Give the samples to the first problem that still waits for them."""
        care = self._care[job.tag]
        while care.tickets and care.samples is not None:
            ticket = care.tickets.pop(0)
            if not ticket.open:
                continue
            ticket.stage(f"the samples of job {job.job_id} were still being read")
            args = (self._maker, ticket.problem, job.chain_order, care.samples, ticket.seed)
            line = None
            try:
                outcome = self._call(calls.read, args, self._settings.call_limit_s)
                if outcome.selected is None:
                    line = f"job {job.job_id}: {outcome.reason}"
            except ServiceFault as fault:
                # Our own doing, not the service's.
                line = f"the samples of job {job.job_id} could not be read: {fault}"
            if line is None and not ticket.offer(replace(outcome, execution=execution_of(job))):
                continue
            if line is not None:
                ticket.decline(line)
            care.samples = None
            self._ledger.update(
                replace(
                    self._ledger[job.tag],
                    answer="used" if line is None else "unfit",
                    answer_cycle=ticket.cycle,
                    updated_ns=self._clock_ns(),
                )
            )
        if care.samples is None:
            for ticket in care.tickets:
                ticket.decline(f"the samples of job {job.job_id} went to another block")
            care.tickets.clear()

    def tidy(self) -> None:
        """Drop what no longer matters; store what could not be stored."""
        self._ledger.flush()
        now_ns = self._clock_ns()
        for job in self._ledger.jobs():
            care = self._care[job.tag]
            care.tickets = [ticket for ticket in care.tickets if ticket.open]
            age_s = (now_ns - (job.finished_ns or now_ns)) / _NS
            if self._is_unread(job) and age_s > self._settings.give_up_after_s:
                care.samples = None
                self._ledger.update(replace(job, answer="late", updated_ns=now_ns))
        for tag in self._ledger.forget():
            del self._care[tag]

    def _begun(self) -> Care:
        return Care(self._clock(), self._settings.poll_s)

    def _tell(self, job: QuantumJob) -> None:
        since = self._clock() - (self._clock_ns() - job.submitted_ns) / _NS
        for ticket in self._care[job.tag].tickets:
            ticket.stage(f"job {job.job_id or job.tag} still {job.state}", since)

    def _fault(self, what: str, fault: ServiceFault) -> str:
        line = f"{what}: {one_line(fault)}"
        self._count(fault.kind, line, fault.retry_s)
        return line

    def _count(self, kind: Any, line: str, retry_s: float | None = None) -> None:
        self._breaker.fault(kind, line, retry_s)
        metrics.QUANTUM_FAULTS.labels(kind).inc()
        if self._limiter.allow(kind):
            held = self._limiter.held(kind)
            more = f" ({held} more of this kind)" if held else ""
            log.warning("quantum device: %s%s", line, more)

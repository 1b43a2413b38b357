"""Results of cycles with a faulty device, and checks of the guarantees."""

from __future__ import annotations

import statistics
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from slipstream_lab.benchmarks.quantum.faulty_service import ServiceRecords
from storage import QuantumJob, open_reader

DAY_S: Final = 30.0
"""The budget's day here, so that many of them pass."""


@dataclass
class Run:
    """Result of a run.

    Attributes:
        cycles: that were run.
        restarts: of job manager and database in between.
        kills: by what was killed.
        answered: cycles by where the circuit's answer came from.
        fallbacks: reasons, their figures left out, by how often.
        walls_s: time of each cycle from its beginning to the stored, verified plan.
        beyond_s: time that the job manager took in each cycle beyond what it may wait for: the
            pool's answers, and the device until the wait or the reserve before the deadline ends.
        events: what the service did, by how often.
        jobs: of the ledger at the end, by state.
        answers: what became of the answers.
        charged_s: device time that the service charged in all.
        max_in_a_day_s: the most of it in any window of the budget's length.
        budget_s: what was allowed.
        limit_s: deadline of a cycle.
        growth: threads, processes, descriptors in the last cycle less those in the first ones, of
            the process that was not killed.
        leaks: the same after all is closed, less before all was opened.
        broken: promises that were not kept; empty if all is well.
    """

    cycles: int = 0
    restarts: int = 0
    kills: Counter[str] = field(default_factory=Counter)
    answered: Counter[str] = field(default_factory=Counter)
    fallbacks: Counter[str] = field(default_factory=Counter)
    walls_s: list[float] = field(default_factory=list)
    beyond_s: list[float] = field(default_factory=list)
    events: dict[str, int] = field(default_factory=dict)
    jobs: dict[str, int] = field(default_factory=dict)
    answers: dict[str, int] = field(default_factory=dict)
    charged_s: float = 0.0
    max_in_a_day_s: float = 0.0
    budget_s: float = 0.0
    limit_s: float = 0.0
    growth: dict[str, int] = field(default_factory=dict)
    leaks: dict[str, int] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)

    def add(self, entry: Mapping[str, Any]) -> None:
        """Count what a cycle wrote down."""
        self.cycles += 1
        self.restarts += entry["restarted"]
        self.kills["worker"] += entry["worker_killed"]
        self.answered[entry["answered"]] += 1
        if entry["fallback"] is not None:
            self.fallbacks[entry["fallback"]] += 1
        self.walls_s.append(entry["wall_s"])
        self.beyond_s.append(entry["beyond_s"])
        self.broken += entry["broken"]

    def report(self) -> dict[str, Any]:
        """All of it for JSON, times as percentiles."""
        figures = dict(vars(self))
        del figures["walls_s"], figures["limit_s"], figures["beyond_s"]
        figures["wall_s"] = _spread(self.walls_s) | {"limit": self.limit_s}
        figures["manager_beyond_s"] = _spread(self.beyond_s)
        return figures


def _spread(times_s: Sequence[float]) -> dict[str, float]:
    ordered = sorted(times_s)
    return {
        "median": round(statistics.median(ordered), 3),
        "p99": round(ordered[int(0.99 * (len(ordered) - 1))], 3),
        "max": round(ordered[-1], 3),
    }


def check_run(records: ServiceRecords, url: str, result: Run) -> None:
    """The ledger against the service's own records, and against the cycles."""
    now = time.time()
    with open_reader(url) as reader:
        ledger = {job.tag: job for job in reader.jobs(limit=10**6)}
        reports = reader.cycles(limit=10**6)
    taken = {job["tag"]: job for job in records.jobs()}
    result.events = dict(records.happened())
    result.jobs = dict(Counter(job.state for job in ledger.values()))
    result.answers = dict(Counter(job.answer or "none" for job in ledger.values()))
    charges = records.charges(now)
    result.charged_s = sum(usage for _, usage in charges)
    result.max_in_a_day_s = records.max_in_a_day_s(now, DAY_S)
    if result.max_in_a_day_s > result.budget_s:
        result.broken.append(f"{result.max_in_a_day_s:.1f} s charged in one window of the budget")
    if len(taken) < len(records.jobs()):
        result.broken.append("a job was submitted twice")
    for tag, theirs in taken.items():
        result.broken += _differences(ledger.get(tag), theirs, now)
    used = Counter(job.answer_cycle for job in ledger.values() if job.answer == "used")
    shown: Counter[int | None] = Counter(
        report.cycle
        for report in reports
        for run in report.solvers
        if run.backend_kind == "hardware"
    )
    # A job manager closed between an answer and its entry leaves the entry out; never the answer.
    # A process that is killed may leave out either.
    killed = result.kills["dispatcher"]
    unseen, unentered = used - shown, shown - used
    if unseen.total() > killed or unentered.total() > result.restarts + killed:
        result.broken.append(f"used: {unseen} unseen, {unentered} not entered")


def _differences(ours: QuantumJob | None, theirs: dict[str, Any], now: float) -> list[str]:
    """What the ledger says of a job that the service knows otherwise."""
    if ours is None:
        return [f"{theirs['tag']} is in no ledger"]
    wrong = []
    if ours.job_id not in (None, theirs["id"]):
        wrong.append(f"{ours.tag} has the id of another job")
    if ours.open:
        wrong.append(f"{ours.tag} is open at the end")
    gone = theirs["cancelled"] or theirs["fate"] == "never" or theirs["ready"] > now
    charged = 0.0 if gone else theirs["usage"]
    counted = ours.estimate_s if ours.usage_s is None else ours.usage_s
    if counted < charged - 1e-9:
        wrong.append(f"{ours.tag} counts {counted:.2f} s, {charged:.2f} s were charged")
    if ours.answer == "used" and theirs["fate"] not in ("ok", "late", "usage unknown"):
        wrong.append(f"the answer of {ours.tag} was used though it was: {theirs['fate']}")
    return wrong

"""Device time in a rolling day, computed from the ledger alone; pure.

A rolling day, not a calendar's: at midnight the latter would let twice its budget through within
an hour. A job counts from before it is submitted until a day after it was found to be over, with
what it was charged once that is known, and with its estimate, or more, until then. So whenever in
a day a job ran, it counts against each job submitted later in that day.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from storage import QuantumJob

DAY_S: Final = 86_400.0


def counted_s(job: QuantumJob) -> float:
    """Device time that a job stands for, s."""
    if not job.open and job.usage_s is not None:
        return job.usage_s
    return max(job.estimate_s, job.usage_s or 0.0)


def counts(job: QuantumJob, now_ns: int, day_s: float = DAY_S) -> bool:
    """True while a job counts."""
    return job.open or job.finished_ns is None or job.finished_ns > now_ns - int(day_s * 1e9)


def used_s(jobs: Iterable[QuantumJob], now_ns: int, day_s: float = DAY_S) -> float:
    """Device time charged or reserved in the day up to now, s."""
    return sum(counted_s(job) for job in jobs if counts(job, now_ns, day_s))


def refusal(used: float, estimate_s: float, budget_s: float) -> str | None:
    """Why no job of that estimate may be submitted; None if it may."""
    if used + estimate_s <= budget_s:
        return None
    said = f"budget of {budget_s:g} s a day used up: {used:.1f} s charged or reserved"
    return f"{said}, the job may take {estimate_s:.1f} s" if estimate_s else said

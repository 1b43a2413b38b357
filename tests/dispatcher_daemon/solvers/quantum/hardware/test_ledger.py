"""The budget: device time in a rolling day."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.solvers.quantum.hardware import ledger

DAY_NS = 86_400 * 10**9
NOW_NS = 10 * DAY_NS


def test_what_a_job_counts_for(harness: Any) -> None:
    """Its estimate while it is open or its charge unknown; its charge, even if higher, after."""
    harness.ask()
    job = harness.job
    over = replace(job, state="lost", finished_ns=NOW_NS)
    assert ledger.counted_s(job) == 4.0
    assert ledger.counted_s(over) == 4.0
    assert ledger.counted_s(replace(over, state="done", usage_s=0.5)) == 0.5
    assert ledger.counted_s(replace(over, state="done", usage_s=6.0)) == 6.0
    assert ledger.counted_s(replace(job, usage_s=0.5)) == 4.0


def test_a_job_counts_for_a_day_after_its_end(harness: Any) -> None:
    """An open one counts however old it is; one that is over, for a day."""
    harness.ask()
    job = replace(harness.job, submitted_ns=0)
    over = replace(job, state="done", usage_s=3.0, finished_ns=NOW_NS - DAY_NS)
    assert ledger.used_s([job, over], NOW_NS) == 4.0
    assert ledger.used_s([job, over], NOW_NS - 1) == 7.0
    assert ledger.used_s([over], NOW_NS - DAY_NS // 2) == 3.0


def test_a_job_that_fits_exactly_may_be_submitted() -> None:
    """The budget may be used up, not passed."""
    assert ledger.budget_refusal(6.0, 4.0, 10.0) is None
    assert ledger.budget_refusal(6.1, 4.0, 10.0) is not None
    assert ledger.budget_refusal(0.0, 10.1, 10.0) is not None


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.floats(0, 3), st.floats(0, 5), st.floats(0, 1), st.booleans()), max_size=60
    )
)
def test_no_window_of_a_day_is_charged_more(steps: list[tuple[float, float, float, bool]]) -> None:
    """Whenever jobs are submitted, run, end and tell their charge: no day of the service's own
    books has more than the budget.
    """
    from tests.dispatcher_daemon.solvers.quantum.hardware.conftest import RunnerHarness

    harness: Any = RunnerHarness()
    harness.ask()
    sample, day_s, limit = harness.job, 10.0, 10.0
    now, jobs, charges = 100.0, [], []
    for gap_s, runs_s, share, tells in steps:
        now += gap_s
        if (
            ledger.budget_refusal(ledger.used_s(jobs, int(now * 1e9), day_s), 4.0, limit)
            is not None
        ):
            continue
        # It runs at some time before it is found to be over; the ledger learns that later.
        at, usage_s = now + share * runs_s, 4.0 * share
        charges.append((at, usage_s))
        over = replace(
            sample,
            tag=str(len(jobs)),
            state="done",
            finished_ns=int((now + runs_s) * 1e9),
            usage_s=usage_s if tells else None,
        )
        now += runs_s
        jobs.append(over)
    for begin, _ in charges:
        in_window = sum(u for at, u in charges if begin <= at <= begin + day_s - 1e-6)
        assert in_window <= limit + 1e-9

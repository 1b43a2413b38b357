"""The ledger of quantum jobs: saved and read back, kept for the budget, pruned in the end."""

from __future__ import annotations

from dataclasses import replace

import storage
from storage import QuantumJob

DAY_NS = 86_400_000_000_000
NOW_NS = 1_790_000_000_000_000_000


def make_job(tag: str, **changes: object) -> QuantumJob:
    """A job that was just handed in."""
    job = QuantumJob(
        tag=tag,
        job_id=None,
        backend="ibm:boston",
        kind="hardware",
        cycle=7,
        submitted_ns=NOW_NS,
        updated_ns=NOW_NS,
        finished_ns=None,
        state="intent",
        reason=None,
        estimate_s=2.5,
        usage_s=None,
        shots=4096,
        circuit="c" * 16,
        variables="v" * 16,
        chain_order=(2, 0, 1),
        variant="linear ramp",
        layers=2,
        two_qubit_depth=None,
        two_qubit_gates=None,
        train_s=0.1,
    )
    return replace(job, **changes)


def test_a_job_is_brought_up_to_date(any_url):
    """What is saved last of a job is what is read, after a restart too; readers see it."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        assert reader.jobs(limit=5) == ()
        database.save_job(make_job("a"))
        assert reader.jobs(limit=5) == (make_job("a"),)
        done = make_job(
            "a",
            job_id="j1",
            state="done",
            usage_s=1.5,
            finished_ns=NOW_NS + 9,
            updated_ns=NOW_NS + 9,
            answer="used",
            answer_cycle=8,
            two_qubit_depth=8,
            two_qubit_gates=48,
        )
        database.save_job(done)
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        assert database.jobs_since(0) == [done]
        assert reader.jobs(limit=5) == (done,)


def test_what_a_restart_needs(any_url):
    """Open jobs of any age and those over within the window are found, oldest first."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        old = make_job("old", state="failed", finished_ns=NOW_NS - DAY_NS - 1)
        recent = make_job("recent", state="lost", finished_ns=NOW_NS - DAY_NS, submitted_ns=NOW_NS)
        queued = make_job("queued", state="queued", job_id="j", submitted_ns=NOW_NS - 9 * DAY_NS)
        for job in (old, recent, queued):
            database.save_job(job)
        assert database.jobs_since(NOW_NS - DAY_NS) == [queued, recent]
        assert [job.tag for job in reader.jobs(limit=2)] == ["old", "recent"]


def test_jobs_of_the_budget_are_not_pruned(any_url, make_cycle):
    """Old jobs go with old cycles; open ones and those of the last two days never do."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(*make_cycle(1))
        for tag, days in (("ancient", 9), ("yesterday", 1)):
            over_ns = NOW_NS - days * DAY_NS
            database.save_job(make_job(tag, state="done", finished_ns=over_ns))
        database.save_job(make_job("open", state="running", submitted_ns=NOW_NS - 90 * DAY_NS))
        database.prune(0.0, NOW_NS)
        assert {job.tag for job in reader.jobs(limit=9)} == {"yesterday", "open"}
        database.trust_clock(NOW_NS + 9 * DAY_NS)
        database.prune(30.0, NOW_NS + 9 * DAY_NS)
        assert {job.tag for job in reader.jobs(limit=9)} == {"yesterday", "open"}

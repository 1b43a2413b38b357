"""Jobs from before they are submitted to their end, fault by fault, on a clock of our own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from dispatcher_daemon.solvers.quantum.backends.jobs import JobView, ServiceFault
from dispatcher_daemon.solvers.quantum.hardware import service
from dispatcher_daemon.solvers.quantum.hardware.ledger import MonotonicUtcClock
from slipstream.errors import InputError

Done = Callable[..., JobView]


def test_a_job_is_stored_before_it_is_submitted_and_answered_in_its_cycle(
    harness: Any, done: Done
) -> None:
    """Intent, id, answer: each is stored when it is known, and the cycle has the answer."""
    seen: list[tuple[str, str | None]] = []
    submit = harness.service.submit
    harness.service.submit = lambda *args: (
        seen.extend((job.state, job.job_id) for job in harness.store.rows.values()),
        submit(*args),
    )[1]
    request = harness.ask()
    assert seen == [("intent", None)]
    assert (harness.job.state, harness.job.job_id, harness.job.estimate_s) == (
        "queued",
        "job-1",
        4.0,
    )
    harness.service.looks = [JobView("running"), done()]
    harness.wait(1.0)
    assert harness.job.state == "running"
    harness.wait(2.0)
    outcome, _ = request.close()
    assert outcome is not None
    assert outcome.selected == frozenset({0})
    ran = outcome.execution
    assert ran is not None
    assert (ran.kind, ran.backend, ran.job, ran.fallback) == ("hardware", "ibm:toy", "job-1", None)
    assert (ran.variant, ran.layers, ran.train_s, ran.sample_s) == ("ramp", 2, 0.25, 2.0)
    job = harness.job
    assert (job.state, job.usage_s, job.answer, job.answer_cycle) == ("done", 1.5, "used", 1)
    assert harness.ledger.used_s() == 1.5
    assert harness.runner.next_poll() is None


def test_a_job_that_queues_is_named_as_the_reason(harness: Any) -> None:
    """At the deadline the cycle learns which job still queues, and for how long."""
    request = harness.ask()
    harness.wait(8.0)
    assert request.close() == (None, "job job-1 still queued after 8.0 s")


def test_a_late_answer_serves_a_later_cycle_of_the_same_variables(harness: Any, done: Done) -> None:
    """It waits for the next cycle whose variables mean the same, and only that one gets it."""
    harness.ask("a", "b").close()
    harness.service.looks = [done()]
    harness.wait(5.0)
    assert (harness.job.state, harness.job.answer) == ("done", None)
    other = harness.ask("a", "c")
    assert other.open
    assert len(harness.store.rows) == 2
    later = harness.ask("a", "b")
    outcome, _ = later.close()
    assert outcome is not None
    assert outcome.execution is not None
    assert outcome.execution.job == "job-1"
    first = next(job for job in harness.store.rows.values() if job.job_id == "job-1")
    assert (first.cycle, first.answer, first.answer_cycle) == (1, "used", 3)
    assert len(harness.store.rows) == 2


def test_a_pending_job_is_waited_for_instead_of_a_second_one(harness: Any, done: Done) -> None:
    """While a job for the same variables is out, a later cycle looks at it at once."""
    harness.ask().close()
    harness.wait(30.0)
    harness.service.looks = [done()]
    request = harness.ask()
    harness.wait(0.0)
    outcome, _ = request.close()
    assert outcome is not None
    assert harness.service.made == 1


def test_an_answer_that_nobody_takes_is_late(harness: Any, done: Done) -> None:
    """After the limit it is recorded as late; its device time counts all the same."""
    harness.ask("a", "b").close()
    harness.service.looks = [done()]
    harness.wait(5.0)
    harness.wait(101.0)
    assert harness.job.answer == "late"
    assert harness.ledger.used_s() == 1.5
    assert harness.ask("a", "b").open
    assert harness.service.made == 2


@pytest.mark.parametrize("fault", [TimeoutError("hung"), ServiceFault("broken", "502"), ""])
def test_a_job_whose_id_was_lost_is_found_by_its_tag(harness: Any, done: Done, fault: Any) -> None:
    """Killed, broken or garbled while submitting: the job is there, and is used like any other."""
    harness.service.submits = [("taken but", fault)]
    request = harness.ask()
    assert (harness.job.state, harness.job.job_id) == ("intent", None)
    assert "not submitted" in (harness.job.reason or "")
    harness.service.looks = [done()]
    harness.wait(1.0)
    assert harness.job.job_id == "job-1"
    harness.wait(1.0)
    assert request.close()[0] is not None


def test_a_job_that_was_never_taken_is_given_up_but_stays_reserved(harness: Any) -> None:
    """A service that never knew it charges nothing, but that is not known: the estimate counts."""
    harness.service.submits = [ServiceFault("unreachable", "no answer within 20 s")]
    request = harness.ask()
    harness.wait(15.0)
    assert request.close()[1] == "not submitted: no answer within 20 s"
    assert harness.job.open
    harness.wait(15.0)
    assert harness.job.state == "lost"
    assert harness.ledger.used_s() == 4.0
    harness.now_s += 86_400.0
    assert harness.ledger.used_s() == 0.0


def test_a_job_that_the_service_forgets_is_given_up(harness: Any) -> None:
    """Once may be a hiccup; for long enough it is the end, and counts against the service."""
    request = harness.ask()
    harness.service.looks = [JobView("lost"), JobView("queued"), *[JobView("lost")] * 20]
    harness.wait(6.0)
    assert harness.job.state == "queued"
    harness.wait(60.0)
    assert (harness.job.state, harness.job.usage_s) == ("lost", None)
    assert harness.ledger.used_s() == 4.0
    assert request.close()[1].startswith("job job-1 lost")


@pytest.mark.parametrize(
    ("fault", "line"),
    [
        (ServiceFault("refused", "401: credentials refused"), "401: credentials refused"),
        (ServiceFault("limited", "429: too many", retry_s=90.0), "429: too many"),
    ],
)
def test_what_is_refused_costs_nothing_and_rests(
    harness: Any, fault: ServiceFault, line: str
) -> None:
    """No job came of it, so nothing is reserved; the breaker opens for its time."""
    harness.service.submits = [fault]
    request = harness.ask()
    assert request.close()[1] == f"not submitted: {line}"
    assert (harness.job.state, harness.job.usage_s, harness.ledger.used_s()) == ("failed", 0.0, 0.0)
    assert harness.breaker.state == "open"
    _, reason = harness.ask().close()
    assert reason.startswith("breaker open until")
    assert line in reason
    harness.wait(3601.0 if fault.kind == "refused" else 91.0)
    harness.ask()
    assert harness.service.made == 1


def test_missing_credentials_are_told_before_anything_is_stored(harness: Any) -> None:
    """A service that cannot be opened is refused like one that refuses."""
    harness.service.opens = [InputError("IBM Quantum", "no credentials", "set them")]
    _, reason = harness.ask().close()
    assert reason == "not prepared: IBM Quantum: no credentials; set them"
    assert harness.store.rows == {}
    assert harness.breaker.state == "open"


@pytest.mark.parametrize(
    ("counts", "line"),
    [
        ({"011": 8}, "no bit string of 2 qubits"),
        ({"02": 8}, "no bit string of 2 qubits"),
        ({"01": 7}, "7 samples instead of 8"),
        ({"01": 17}, "17 samples instead of 8"),
        ({"01": 9, "10": -1}, "-1 shots"),
        ([("01", 8)], "holds no samples"),
        (None, "done, but without samples"),
    ],
)
def test_garbage_is_never_read(harness: Any, done: Done, counts: Any, line: str) -> None:
    """Samples that cannot be are a failed job, charged as the service says, and a fault."""
    request = harness.ask()
    harness.service.looks = [done(counts)]
    harness.wait(1.0)
    job = harness.job
    assert (job.state, job.usage_s, job.answer) == ("failed", 1.5, None)
    assert line in (job.reason or "")
    assert line in request.close()[1]


@pytest.mark.parametrize("usage_s", [None, -1.0, float("nan"), "3"])
def test_a_charge_that_cannot_be_believed_leaves_the_estimate(
    harness: Any, done: Done, usage_s: Any
) -> None:
    """Until a true charge is told, the reserved time counts, and it is asked for again."""
    harness.ask()
    harness.service.looks = [done(usage_s=usage_s)]
    harness.wait(1.0)
    assert (harness.job.state, harness.job.usage_s, harness.ledger.used_s()) == ("done", None, 4.0)
    harness.service.looks = [done(usage_s=0.5)]
    harness.wait(10.0)
    assert harness.ledger.used_s() == 0.5
    assert harness.runner.next_poll() is None


def test_what_is_no_view_is_a_fault_and_ends_with_the_limit(harness: Any) -> None:
    """A job of which only nonsense is told is cancelled and given up, still counted."""
    harness.ask()
    harness.service.looks = [{"status": "Completed"}] * 99
    harness.wait(99.0)
    assert harness.job.state == "queued"
    assert harness.breaker.state == "open"
    harness.wait(40.0)
    assert (harness.job.state, harness.service.cancelled) == ("lost", ["job-1"])
    assert harness.ledger.used_s() == 4.0


def test_a_job_that_takes_too_long_is_cancelled(harness: Any) -> None:
    """Past the limit it is taken out of the queue; what it was charged by then is settled."""
    harness.ask().close()
    harness.service.cancels = [ServiceFault("broken", "500")]
    harness.wait(105.0)
    assert harness.service.cancelled == []
    harness.wait(10.0)
    assert harness.service.cancelled == ["job-1"]
    assert harness.job.open
    harness.service.looks = [JobView("cancelled", usage_s=0.0)]
    harness.wait(10.0)
    assert (harness.job.state, harness.job.usage_s) == ("cancelled", 0.0)
    assert (harness.job.reason or "").startswith("cancelled: no answer within 1")


def test_a_job_that_fails_says_why(harness: Any) -> None:
    """The service's reason is the cycle's, in one line."""
    request = harness.ask()
    harness.service.looks = [JobView("failed", "qubit 7 is\nout of order", usage_s=0.25)]
    harness.wait(1.0)
    assert request.close()[1] == "job job-1 failed: qubit 7 is out of order"
    assert harness.ledger.used_s() == 0.25


def test_samples_without_routes_fall_back(harness: Any, done: Done) -> None:
    """An answer that leads nowhere is told as such and not offered again."""
    request = harness.ask()
    harness.service.looks = [done({"00": 8})]
    harness.wait(1.0)
    assert request.close() == (None, "job job-1: no sample led to a route")
    assert (harness.job.answer, harness.job.answer_cycle) == ("unfit", 1)


def test_the_budget_cannot_be_passed(harness: Any, done: Done) -> None:
    """Two jobs of 4 s fit into 10 s, a third only once the true charges leave room for it."""
    harness.settings = harness.settings.model_copy(update={"max_pending_jobs": 9})
    harness.restart()
    harness.ask("a")
    harness.ask("b")
    _, reason = harness.ask("c").close()
    assert reason == (
        "budget of 10 s a day used up: 8.0 s charged or reserved, the job may take 4.0 s"
    )
    assert harness.service.made == 2
    harness.service.looks = [done(usage_s=2.0)]
    harness.wait(1.0)
    assert harness.ledger.used_s() == 6.0
    harness.ask("f")
    assert (harness.service.made, harness.ledger.used_s()) == (3, 10.0)
    _, reason = harness.ask("e").close()
    assert "10.0 s charged or reserved" in reason
    assert harness.runner.refusal() == reason


def test_the_budget_outlives_restarts(harness: Any, done: Done) -> None:
    """What is reserved or charged is in the ledger, so a restart gives no second budget."""
    harness.ask("a")
    harness.service.looks = [done(usage_s=7.0)]
    harness.wait(1.0)
    harness.restart()
    assert harness.ledger.used_s() == 7.0
    assert "budget of 10 s" in harness.ask("b").close()[1]
    assert harness.service.made == 1


def test_pending_jobs_are_found_again_after_a_restart(harness: Any, done: Done) -> None:
    """One with an id, one whose id was lost: both are looked at, and their answers are used."""
    harness.ask("a")
    harness.service.submits = [("taken but", TimeoutError("killed"))]
    harness.ask("b")
    harness.restart()
    harness.service.looks = [done(), done()]
    harness.wait(5.0)
    assert {job.state for job in harness.store.rows.values()} == {"done"}
    for stop in ("a", "b"):
        assert harness.ask(stop).close()[0] is not None
    assert harness.service.made == 2


@pytest.mark.parametrize("counts", [{"011": 8}, None])
def test_samples_fetched_again_are_checked_again(harness: Any, done: Done, counts: Any) -> None:
    """What was good before a restart need not be after it; garbage is unfit, and told at once."""
    harness.ask("a").close()
    harness.service.looks = [done()]
    harness.wait(1.0)
    harness.restart()
    request = harness.ask("a")
    harness.service.looks = [done(counts)]
    harness.wait(0.0)
    assert (harness.job.state, harness.job.answer) == ("done", "unfit")
    outcome, reason = request.close()
    assert outcome is None
    assert "garbage" in reason
    assert harness.breaker._faults == 1
    assert harness.runner.next_poll() is None


def test_a_charge_that_never_comes_is_asked_for_rarely(harness: Any, done: Done) -> None:
    """Some dozen looks in a day, none of which fetches the samples again."""
    request = harness.ask()
    harness.service.looks = [done(usage_s=None)] * 999
    harness.wait(1.0)
    assert request.close()[0] is not None
    assert harness.service.asked == [True]
    harness.wait(80_000.0)
    assert not any(harness.service.asked[1:])
    assert 20 < len(harness.service.asked) < 60


def test_samples_that_nobody_has_read_are_fetched_once(harness: Any, done: Done) -> None:
    """They are kept until a cycle reads them, while its charge is still asked for."""
    harness.ask("a").close()
    harness.service.looks = [done(usage_s=None), JobView("done"), JobView("done", usage_s=1.0)]
    harness.wait(30.0)
    assert harness.service.asked == [True, False, False]
    assert harness.ask("a").close()[0] is not None
    assert harness.ledger.used_s() == 1.0


def test_a_service_that_chose_its_device_is_opened_again(
    harness: Any, done: Done, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before a job, once it is old; not for a look, and no other service ever."""
    now = [0.0]
    monkeypatch.setattr(service.time, "monotonic", lambda: now[0])
    for max_age_s, opened in ((3600.0, 2), (float("inf"), 1)):
        harness.service = type(harness.service)(max_age_s=max_age_s)
        harness.store.rows.clear()
        harness.restart()
        harness.ask("a")
        now[0] += 3700.0
        harness.service.looks = [done()]
        harness.wait(2.0)
        assert harness.service.opened == 1
        harness.ask("b")
        harness.ask("c")
        assert harness.service.opened == opened


def test_a_queue_without_an_end_is_a_fault(harness: Any) -> None:
    """A device that answers nothing within the limit opens the breaker like one that breaks."""
    for number in range(3):
        harness.ask(f"stop-{number}")
        harness.service.looks = []
        harness.wait(101.0)
        harness.service.looks = [JobView("cancelled", usage_s=0.0)]
        harness.wait(20.0)
    assert harness.service.cancelled == ["job-1", "job-2", "job-3"]
    assert harness.breaker.state == "open"
    assert "no answer within" in (harness.breaker.refusal() or "")


def test_jobs_of_another_kind_of_device_are_left_alone(harness: Any) -> None:
    """A trial on a simulator neither looks after a device's jobs nor pays for them."""
    harness.ask()
    harness.store.rows = {
        tag: job.__class__(**{**vars(job), "kind": "noise-model"})
        for tag, job in harness.store.rows.items()
    }
    harness.restart()
    assert harness.ledger.jobs() == []
    assert harness.runner.next_poll() is None


def test_only_so_many_jobs_are_out_at_once(harness: Any, make_harness: Any, limits: Any) -> None:
    """A third job has to wait for one of two to end; and a cycle submits no more than it may."""
    harness.ask("a")
    harness.ask("b")
    assert harness.ask("c").close()[1] == "2 jobs are pending already"
    one = make_harness(limits.model_copy(update={"jobs_per_cycle": 1}))
    first = one.ask("a")
    one.runner.serve(second := type(first)(first.problem, "other", 1, 1, 1e9))
    assert second.close()[1] == "no more than 1 jobs a cycle"


def test_nothing_is_submitted_that_could_not_be_stored(harness: Any) -> None:
    """A full disk costs the device, not the cycle; it goes on once there is room."""
    harness.store.broken = True
    _, reason = harness.ask().close()
    assert reason == "no job, as it could not be stored: x.db: disk full"
    assert harness.service.made == 0
    harness.store.broken = False
    harness.ask()
    assert harness.service.made == 1


def test_a_database_that_is_down_is_told_of_once(
    harness: Any, done: Done, caplog: pytest.LogCaptureFixture
) -> None:
    """One line a minute, not one each round; a job that is refused holds up no other."""
    harness.ask("a")
    harness.ask("b")
    harness.store.broken = True
    harness.service.looks = [done(), done()]
    for _ in range(9):
        harness.wait(1.0)
    assert sum("could not be stored yet" in line for line in caplog.messages) == 1
    harness.store.broken = False
    save, refused = harness.store.save_job, min(harness.store.rows)

    def save_other(job: Any) -> None:
        if job.tag == refused:
            raise ValueError("refused")
        save(job)

    harness.store.save_job = save_other
    harness.wait(1.0)
    assert sorted(job.state for job in harness.store.rows.values()) == ["done", "queued"]


def test_repeated_faults_open_the_breaker_and_one_job_closes_it(harness: Any, done: Done) -> None:
    """Three faults, a rest, one job on trial; a good answer makes up for all."""
    harness.settings = harness.settings.model_copy(update={"budget_s_per_day": 100.0})
    harness.restart()
    for number in range(3):
        harness.service.submits = [ServiceFault("broken", "500")]
        harness.ask(f"stop-{number}").close()
        harness.wait(30.0)
    assert harness.breaker.state == "open"
    assert "500" in harness.ask("x").close()[1]
    harness.wait(60.0)
    assert harness.breaker.state == "half-open"
    trial = harness.ask("y")
    assert harness.breaker.state == "closed"
    harness.service.looks = [done()]
    harness.wait(1.0)
    assert trial.close()[0] is not None


def rest(harness: Any) -> None:
    """Open the breaker, and wait until one job may be tried."""
    for _ in range(3):
        harness.breaker.fault("broken", "500")
    harness.wait(60.0)
    assert harness.breaker.state == "half-open"


def test_a_circuit_that_does_not_fit_is_no_trial(harness: Any) -> None:
    """Half-open, nothing is learnt of the service from it, so that the next job is tried."""
    rest(harness)
    harness.service.submits = [InputError("ibm:toy", "200 qubits do not fit", "take fewer")]
    assert "do not fit" in harness.ask("a").close()[1]
    assert harness.breaker.refusal() is None
    harness.ask("b")
    assert (harness.service.made, harness.breaker.state) == (1, "closed")


def test_a_fault_of_our_own_is_no_trial(harness: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is raised while a job is on trial, the breaker does not wait for ever."""
    rest(harness)
    call = harness.call

    def broken(function: Any, args: Any, limit_s: float) -> Any:
        if function is service.submit:
            raise KeyError("ours")
        return call(function, args, limit_s)

    monkeypatch.setattr(harness.runner, "_call", broken)
    with pytest.raises(KeyError):
        harness.ask("a")
    assert harness.breaker.refusal() is None


def test_a_clock_that_is_set_ages_no_job_and_frees_no_budget(harness: Any, done: Done) -> None:
    """A day forwards by the wall clock: what is out stays out, what is used stays used."""
    wall_ns = [10**18]
    now_ns = MonotonicUtcClock(lambda: wall_ns[0], lambda: int(harness.now_s * 1e9))
    harness.now_ns = now_ns
    harness.restart()
    harness.ask("a")
    harness.service.looks = [done(usage_s=3.0)]
    harness.wait(1.0)
    harness.ask("b")
    wall_ns[0] += int(25 * 3600e9)
    harness.wait(30.0)
    assert harness.ledger.used_s() == 7.0
    assert harness.service.cancelled == []
    assert len(harness.ledger.pending()) == 1
    harness.now_s += 86_400.0
    assert harness.ledger.used_s() == 4.0

"""Jobs from before they are submitted to their end, fault by fault, on a clock of our own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from dispatcher_daemon.hardware import calls
from dispatcher_daemon.hardware.steady_clock import SteadyClock
from dispatcher_daemon.solvers.quantum.backends.jobs import JobView, ServiceFault
from slipstream.errors import InputError

Done = Callable[..., JobView]


def test_a_job_is_stored_before_it_is_submitted_and_answered_in_its_cycle(
    world: Any, done: Done
) -> None:
    """Intent, id, answer: each is stored when it is known, and the cycle has the answer."""
    seen: list[tuple[str, str | None]] = []
    submit = world.service.submit
    world.service.submit = lambda *args: (
        seen.extend((job.state, job.job_id) for job in world.store.rows.values()),
        submit(*args),
    )[1]
    ticket = world.ask()
    assert seen == [("intent", None)]
    assert (world.job.state, world.job.job_id, world.job.estimate_s) == ("queued", "job-1", 4.0)
    world.service.looks = [JobView("running"), done()]
    world.wait(1.0)
    assert world.job.state == "running"
    world.wait(2.0)
    outcome, _ = ticket.close()
    assert outcome is not None
    assert outcome.selected == frozenset({0})
    ran = outcome.execution
    assert ran is not None
    assert (ran.kind, ran.backend, ran.job, ran.fallback) == ("hardware", "ibm:toy", "job-1", None)
    assert (ran.variant, ran.layers, ran.train_s, ran.sample_s) == ("ramp", 2, 0.25, 2.0)
    job = world.job
    assert (job.state, job.usage_s, job.answer, job.answer_cycle) == ("done", 1.5, "used", 1)
    assert world.ledger.used_s() == 1.5
    assert world.caretaker.next_look() is None


def test_more_samples_than_asked_for_are_taken(world: Any, done: Done) -> None:
    """A device that takes samples in whole frames may give some more."""
    ticket = world.ask()
    world.service.looks = [done({"01": 9})]
    world.wait(1.0)
    assert ticket.close()[0] is not None


def test_a_job_that_queues_is_named_as_the_reason(world: Any) -> None:
    """At the deadline the cycle learns which job still queues, and for how long."""
    ticket = world.ask()
    world.wait(8.0)
    assert ticket.close() == (None, "job job-1 still queued after 8.0 s")


def test_a_late_answer_serves_a_later_cycle_of_the_same_variables(world: Any, done: Done) -> None:
    """It waits for the next cycle whose variables mean the same, and only that one gets it."""
    world.ask("a", "b").close()
    world.service.looks = [done()]
    world.wait(5.0)
    assert (world.job.state, world.job.answer) == ("done", None)
    other = world.ask("a", "c")
    assert other.open
    assert len(world.store.rows) == 2
    later = world.ask("a", "b")
    outcome, _ = later.close()
    assert outcome is not None
    assert outcome.execution is not None
    assert outcome.execution.job == "job-1"
    first = next(job for job in world.store.rows.values() if job.job_id == "job-1")
    assert (first.cycle, first.answer, first.answer_cycle) == (1, "used", 3)
    assert len(world.store.rows) == 2


def test_a_pending_job_is_waited_for_instead_of_a_second_one(world: Any, done: Done) -> None:
    """While a job for the same variables is out, a later cycle looks at it at once."""
    world.ask().close()
    world.wait(30.0)
    world.service.looks = [done()]
    ticket = world.ask()
    world.wait(0.0)
    outcome, _ = ticket.close()
    assert outcome is not None
    assert world.service.made == 1


def test_an_answer_that_nobody_takes_is_late(world: Any, done: Done) -> None:
    """After the limit it is recorded as late; its device time counts all the same."""
    world.ask("a", "b").close()
    world.service.looks = [done()]
    world.wait(5.0)
    world.wait(101.0)
    assert world.job.answer == "late"
    assert world.ledger.used_s() == 1.5
    assert world.ask("a", "b").open
    assert world.service.made == 2


@pytest.mark.parametrize("fault", [TimeoutError("hung"), ServiceFault("broken", "502"), ""])
def test_a_job_whose_id_was_lost_is_found_by_its_tag(world: Any, done: Done, fault: Any) -> None:
    """Killed, broken or garbled while submitting: the job is there, and is used like any other."""
    world.service.submits = [("taken but", fault)]
    ticket = world.ask()
    assert (world.job.state, world.job.job_id) == ("intent", None)
    assert "not submitted" in (world.job.reason or "")
    world.service.looks = [done()]
    world.wait(1.0)
    assert world.job.job_id == "job-1"
    world.wait(1.0)
    assert ticket.close()[0] is not None


def test_a_job_that_was_never_taken_is_given_up_but_stays_reserved(world: Any) -> None:
    """A service that never knew it charges nothing, but that is not known: the estimate counts."""
    world.service.submits = [ServiceFault("unreachable", "no answer within 20 s")]
    ticket = world.ask()
    world.wait(15.0)
    assert ticket.close()[1] == "not submitted: no answer within 20 s"
    assert world.job.open
    world.wait(15.0)
    assert world.job.state == "lost"
    assert world.ledger.used_s() == 4.0
    world.now_s += 86_400.0
    assert world.ledger.used_s() == 0.0


def test_a_job_that_the_service_forgets_is_given_up(world: Any) -> None:
    """Once may be a hiccup; for long enough it is the end, and counts against the service."""
    ticket = world.ask()
    world.service.looks = [JobView("lost"), JobView("queued"), *[JobView("lost")] * 20]
    world.wait(6.0)
    assert world.job.state == "queued"
    world.wait(60.0)
    assert (world.job.state, world.job.usage_s) == ("lost", None)
    assert world.ledger.used_s() == 4.0
    assert ticket.close()[1].startswith("job job-1 lost")


@pytest.mark.parametrize(
    ("fault", "line"),
    [
        (ServiceFault("refused", "401: credentials refused"), "401: credentials refused"),
        (ServiceFault("limited", "429: too many", retry_s=90.0), "429: too many"),
    ],
)
def test_what_is_refused_costs_nothing_and_rests(
    world: Any, fault: ServiceFault, line: str
) -> None:
    """No job came of it, so nothing is reserved; the breaker opens for its time."""
    world.service.submits = [fault]
    ticket = world.ask()
    assert ticket.close()[1] == f"not submitted: {line}"
    assert (world.job.state, world.job.usage_s, world.ledger.used_s()) == ("failed", 0.0, 0.0)
    assert world.breaker.state == "open"
    _, reason = world.ask().close()
    assert reason.startswith("breaker open until")
    assert line in reason
    world.wait(3601.0 if fault.kind == "refused" else 91.0)
    world.ask()
    assert world.service.made == 1


def test_missing_credentials_are_told_before_anything_is_stored(world: Any) -> None:
    """A service that cannot be opened is refused like one that refuses."""
    world.service.opens = [InputError("IBM Quantum", "no credentials", "set them")]
    _, reason = world.ask().close()
    assert reason == "not prepared: IBM Quantum: no credentials; set them"
    assert world.store.rows == {}
    assert world.breaker.state == "open"


@pytest.mark.parametrize(
    ("counts", "line"),
    [
        ({"011": 8}, "no bit string of 2 qubits"),
        ({"0": 8}, "no bit string of 2 qubits"),
        ({"02": 8}, "no bit string of 2 qubits"),
        ({1: 8}, "no bit string of 2 qubits"),
        ({"01": 7}, "7 samples instead of 8"),
        ({"01": 17}, "17 samples instead of 8"),
        ({"01": 9, "10": -1}, "-1 shots"),
        ({"01": 8.0}, "8.0 shots"),
        ({}, "0 samples instead of 8"),
        ([("01", 8)], "holds no samples"),
        (None, "done, but without samples"),
    ],
)
def test_garbage_is_never_read(world: Any, done: Done, counts: Any, line: str) -> None:
    """Samples that cannot be are a failed job, charged as the service says, and a fault."""
    ticket = world.ask()
    world.service.looks = [done(counts)]
    world.wait(1.0)
    job = world.job
    assert (job.state, job.usage_s, job.answer) == ("failed", 1.5, None)
    assert line in (job.reason or "")
    assert line in ticket.close()[1]


@pytest.mark.parametrize("usage_s", [None, -1.0, float("nan"), float("inf"), "3", True])
def test_a_charge_that_cannot_be_believed_leaves_the_estimate(
    world: Any, done: Done, usage_s: Any
) -> None:
    """Until a true charge is told, the reserved time counts, and it is asked for again."""
    world.ask()
    world.service.looks = [done(usage_s=usage_s)]
    world.wait(1.0)
    assert (world.job.state, world.job.usage_s, world.ledger.used_s()) == ("done", None, 4.0)
    world.service.looks = [done(usage_s=0.5)]
    world.wait(10.0)
    assert world.ledger.used_s() == 0.5
    assert world.caretaker.next_look() is None


def test_what_is_no_view_is_a_fault_and_ends_with_the_limit(world: Any) -> None:
    """A job of which only nonsense is told is cancelled and given up, still counted."""
    world.ask()
    world.service.looks = [{"status": "Completed"}] * 99
    world.wait(99.0)
    assert world.job.state == "queued"
    assert world.breaker.state == "open"
    world.wait(40.0)
    assert (world.job.state, world.service.cancelled) == ("lost", ["job-1"])
    assert world.ledger.used_s() == 4.0


def test_a_job_that_takes_too_long_is_cancelled(world: Any) -> None:
    """Past the limit it is taken out of the queue; what it was charged by then is settled."""
    world.ask().close()
    world.service.cancels = [ServiceFault("broken", "500")]
    world.wait(105.0)
    assert world.service.cancelled == []
    world.wait(10.0)
    assert world.service.cancelled == ["job-1"]
    assert world.job.open
    world.service.looks = [JobView("cancelled", usage_s=0.0)]
    world.wait(10.0)
    assert (world.job.state, world.job.usage_s) == ("cancelled", 0.0)
    assert (world.job.reason or "").startswith("cancelled: no answer within 1")


def test_a_job_that_fails_says_why(world: Any) -> None:
    """The service's reason is the cycle's, in one line."""
    ticket = world.ask()
    world.service.looks = [JobView("failed", "qubit 7 is\nout of order", usage_s=0.25)]
    world.wait(1.0)
    assert ticket.close()[1] == "job job-1 failed: qubit 7 is out of order"
    assert world.ledger.used_s() == 0.25


def test_samples_without_routes_fall_back(world: Any, done: Done) -> None:
    """An answer that leads nowhere is told as such and not offered again."""
    ticket = world.ask()
    world.service.looks = [done({"00": 8})]
    world.wait(1.0)
    assert ticket.close() == (None, "job job-1: no sample led to a route")
    assert (world.job.answer, world.job.answer_cycle) == ("unfit", 1)


def test_the_budget_cannot_be_passed(world: Any, done: Done) -> None:
    """Two jobs of 4 s fit into 10 s, a third only once the true charges leave room for it."""
    world.settings = world.settings.model_copy(update={"most_pending": 9})
    world.restart()
    world.ask("a")
    world.ask("b")
    _, reason = world.ask("c").close()
    assert reason == (
        "budget of 10 s a day used up: 8.0 s charged or reserved, the job may take 4.0 s"
    )
    assert world.service.made == 2
    world.service.looks = [done(usage_s=2.0)]
    world.wait(1.0)
    assert world.ledger.used_s() == 6.0
    world.ask("f")
    assert (world.service.made, world.ledger.used_s()) == (3, 10.0)
    _, reason = world.ask("e").close()
    assert "10.0 s charged or reserved" in reason
    assert world.caretaker.refusal() == reason


def test_the_budget_outlives_restarts(world: Any, done: Done) -> None:
    """What is reserved or charged is in the ledger, so a restart gives no second budget."""
    world.ask("a")
    world.service.looks = [done(usage_s=7.0)]
    world.wait(1.0)
    world.restart()
    assert world.ledger.used_s() == 7.0
    assert "budget of 10 s" in world.ask("b").close()[1]
    assert world.service.made == 1


def test_pending_jobs_are_found_again_after_a_restart(world: Any, done: Done) -> None:
    """One with an id, one whose id was lost: both are looked at, and their answers are used."""
    world.ask("a")
    world.service.submits = [("taken but", TimeoutError("killed"))]
    world.ask("b")
    world.restart()
    world.service.looks = [done(), done()]
    world.wait(5.0)
    assert {job.state for job in world.store.rows.values()} == {"done"}
    for stop in ("a", "b"):
        assert world.ask(stop).close()[0] is not None
    assert world.service.made == 2


def test_an_answer_unread_at_a_restart_is_fetched_again(world: Any, done: Done) -> None:
    """Samples are not stored; the service still has them."""
    world.ask("a").close()
    world.service.looks = [done()]
    world.wait(1.0)
    world.restart()
    ticket = world.ask("a")
    world.service.looks = [done()]
    world.wait(0.0)
    assert ticket.close()[0] is not None
    assert (world.service.made, world.job.answer_cycle) == (1, 2)


@pytest.mark.parametrize("counts", [{"011": 8}, {"01": 1}, {"01": 9, "10": -1}, None])
def test_samples_fetched_again_are_checked_again(world: Any, done: Done, counts: Any) -> None:
    """What was good before a restart need not be after it; garbage is unfit, and told at once."""
    world.ask("a").close()
    world.service.looks = [done()]
    world.wait(1.0)
    world.restart()
    ticket = world.ask("a")
    world.service.looks = [done(counts)]
    world.wait(0.0)
    assert (world.job.state, world.job.answer) == ("done", "unfit")
    outcome, reason = ticket.close()
    assert outcome is None
    assert "garbage" in reason
    assert world.breaker._faults == 1
    assert world.caretaker.next_look() is None


def test_a_charge_that_never_comes_is_asked_for_rarely(world: Any, done: Done) -> None:
    """Some dozen looks in a day, none of which fetches the samples again."""
    ticket = world.ask()
    world.service.looks = [done(usage_s=None)] * 999
    world.wait(1.0)
    assert ticket.close()[0] is not None
    assert world.service.asked == [True]
    world.wait(80_000.0)
    assert not any(world.service.asked[1:])
    assert 20 < len(world.service.asked) < 60


def test_samples_that_nobody_has_read_are_fetched_once(world: Any, done: Done) -> None:
    """They are kept until a cycle reads them, while its charge is still asked for."""
    world.ask("a").close()
    world.service.looks = [done(usage_s=None), JobView("done"), JobView("done", usage_s=1.0)]
    world.wait(30.0)
    assert world.service.asked == [True, False, False]
    assert world.ask("a").close()[0] is not None
    assert world.ledger.used_s() == 1.0


def test_a_service_that_chose_its_device_is_opened_again(
    world: Any, done: Done, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before a job, once it is old; not for a look, and no other service ever."""
    now = [0.0]
    monkeypatch.setattr(calls.time, "monotonic", lambda: now[0])
    for stale_s, opened in ((3600.0, 2), (float("inf"), 1)):
        world.service = type(world.service)(stale_s=stale_s)
        world.store.rows.clear()
        world.restart()
        world.ask("a")
        now[0] += 3700.0
        world.service.looks = [done()]
        world.wait(2.0)
        assert world.service.opened == 1
        world.ask("b")
        world.ask("c")
        assert world.service.opened == opened


def test_a_queue_without_an_end_is_a_fault(world: Any) -> None:
    """A device that answers nothing within the limit opens the breaker like one that breaks."""
    for number in range(3):
        world.ask(f"stop-{number}")
        world.service.looks = []
        world.wait(101.0)
        world.service.looks = [JobView("cancelled", usage_s=0.0)]
        world.wait(20.0)
    assert world.service.cancelled == ["job-1", "job-2", "job-3"]
    assert world.breaker.state == "open"
    assert "no answer within" in (world.breaker.refusal() or "")


def test_jobs_of_another_kind_of_device_are_left_alone(world: Any) -> None:
    """A trial on a simulator neither looks after a device's jobs nor pays for them."""
    world.ask()
    world.store.rows = {
        tag: job.__class__(**{**vars(job), "kind": "noise-model"})
        for tag, job in world.store.rows.items()
    }
    world.restart()
    assert world.ledger.jobs() == []
    assert world.caretaker.next_look() is None


def test_only_so_many_jobs_are_out_at_once(world: Any, make_world: Any, limits: Any) -> None:
    """A third job has to wait for one of two to end; and a cycle submits no more than it may."""
    world.ask("a")
    world.ask("b")
    assert world.ask("c").close()[1] == "2 jobs are pending already"
    one = make_world(limits.model_copy(update={"jobs_per_cycle": 1}))
    first = one.ask("a")
    one.caretaker.serve(second := type(first)(first.problem, "other", 1, 1, 1e9))
    assert second.close()[1] == "no more than 1 jobs a cycle"


def test_nothing_is_submitted_that_could_not_be_stored(world: Any) -> None:
    """A full disk costs the device, not the cycle; it goes on once there is room."""
    world.store.broken = True
    _, reason = world.ask().close()
    assert reason == "no job, as it could not be stored: x.db: disk full"
    assert world.service.made == 0
    world.store.broken = False
    world.ask()
    assert world.service.made == 1


def test_a_job_that_the_database_refuses_is_declined_at_once(world: Any) -> None:
    """A fault of another kind than a full disk holds no cycle up either."""

    def refuse(job: object) -> None:
        raise ValueError("UNIQUE constraint failed")

    world.store.save_job = refuse
    ticket = world.ask()
    assert not ticket.open
    assert ticket.close()[1].endswith("could not be stored: ValueError: UNIQUE constraint failed")
    assert world.service.made == 0


def test_a_database_that_is_down_is_told_of_once(
    world: Any, done: Done, caplog: pytest.LogCaptureFixture
) -> None:
    """One line a minute, not one each round; a job that is refused holds up no other."""
    world.ask("a")
    world.ask("b")
    world.store.broken = True
    world.service.looks = [done(), done()]
    for _ in range(9):
        world.wait(1.0)
    assert sum("could not be stored yet" in line for line in caplog.messages) == 1
    world.store.broken = False
    save, refused = world.store.save_job, min(world.store.rows)

    def save_other(job: Any) -> None:
        if job.tag == refused:
            raise ValueError("refused")
        save(job)

    world.store.save_job = save_other
    world.wait(1.0)
    assert sorted(job.state for job in world.store.rows.values()) == ["done", "queued"]


def test_news_that_could_not_be_stored_are_stored_later(world: Any, done: Done) -> None:
    """They count at once, and reach the database when it takes them."""
    world.ask()
    world.store.broken = True
    world.service.looks = [done()]
    world.wait(1.0)
    assert (world.ledger.used_s(), world.job.state) == (1.5, "queued")
    world.store.broken = False
    world.wait(0.0)
    assert world.job.state == "done"


def test_repeated_faults_open_the_breaker_and_one_job_closes_it(world: Any, done: Done) -> None:
    """Three faults, a rest, one job on trial; a good answer makes up for all."""
    world.settings = world.settings.model_copy(update={"budget_s_per_day": 100.0})
    world.restart()
    for number in range(3):
        world.service.submits = [ServiceFault("broken", "500")]
        world.ask(f"stop-{number}").close()
        world.wait(30.0)
    assert world.breaker.state == "open"
    assert "500" in world.ask("x").close()[1]
    world.wait(60.0)
    assert world.breaker.state == "half-open"
    trial = world.ask("y")
    assert world.breaker.state == "closed"
    world.service.looks = [done()]
    world.wait(1.0)
    assert trial.close()[0] is not None


def test_a_circuit_that_does_not_fit_the_device_is_nobodys_fault(world: Any) -> None:
    """Told as it is; nothing is reserved, and the breaker stays closed."""
    world.service.submits = [InputError("ibm:toy", "200 qubits do not fit", "take fewer")]
    assert world.ask().close()[1] == "ibm:toy: 200 qubits do not fit; take fewer"
    assert (world.job.state, world.ledger.used_s()) == ("failed", 0.0)
    assert world.breaker.state == "closed"


def rest(world: Any) -> None:
    """Open the breaker, and wait until one job may be tried."""
    for _ in range(3):
        world.breaker.fault("broken", "500")
    world.wait(60.0)
    assert world.breaker.state == "half-open"


def test_a_circuit_that_does_not_fit_is_no_trial(world: Any) -> None:
    """Half-open, nothing is learnt of the service from it, so that the next job is tried."""
    rest(world)
    world.service.submits = [InputError("ibm:toy", "200 qubits do not fit", "take fewer")]
    assert "do not fit" in world.ask("a").close()[1]
    assert world.breaker.refusal() is None
    world.ask("b")
    assert (world.service.made, world.breaker.state) == (1, "closed")


def test_a_fault_of_our_own_is_no_trial(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is raised while a job is on trial, the breaker does not wait for ever."""
    rest(world)
    call = world.call

    def broken(function: Any, args: Any, limit_s: float) -> Any:
        if function is calls.submit:
            raise KeyError("ours")
        return call(function, args, limit_s)

    monkeypatch.setattr(world.caretaker, "_call", broken)
    with pytest.raises(KeyError):
        world.ask("a")
    assert world.breaker.refusal() is None


def test_a_clock_that_is_set_ages_no_job_and_frees_no_budget(world: Any, done: Done) -> None:
    """A day forwards by the wall clock: what is out stays out, what is used stays used."""
    wall_ns = [10**18]
    now_ns = SteadyClock(lambda: wall_ns[0], lambda: int(world.now_s * 1e9))
    world.now_ns = now_ns
    world.restart()
    world.ask("a")
    world.service.looks = [done(usage_s=3.0)]
    world.wait(1.0)
    world.ask("b")
    wall_ns[0] += int(25 * 3600e9)
    world.wait(30.0)
    assert world.ledger.used_s() == 7.0
    assert world.service.cancelled == []
    assert len(world.ledger.pending()) == 1
    world.now_s += 86_400.0
    assert world.ledger.used_s() == 4.0


def test_a_problem_without_a_circuit_is_nobodys_fault(world: Any) -> None:
    """Nothing to choose: no job, no fault."""
    problem = toy_problem_without_arcs()
    ticket = type(world.ask("a"))(problem, "m", 1, 9, 1e9)
    world.caretaker.serve(ticket)
    assert ticket.close()[1] == "nothing to choose"
    assert world.breaker.state == "closed"


def toy_problem_without_arcs() -> Any:
    """Nobody can drive anywhere."""
    from dispatcher_daemon.problem import ArcProblem

    return ArcProblem("d", (), ("v",), ())

"""The circuit breaker on a clock of our own."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from dispatcher_daemon.solvers.quantum.hardware.breaker import CircuitBreaker, JobLimits


class Clock:
    """Seconds that go by when told."""

    now = 50.0

    def __call__(self) -> float:
        """Now."""
        return self.now


@pytest.fixture
def clock() -> Clock:
    """A clock of our own."""
    return Clock()


@pytest.fixture
def breaker(clock: Callable[[], float]) -> CircuitBreaker:
    """Three faults open it for 10, 20, 40, then always 60 s."""
    return CircuitBreaker(JobLimits(fault_threshold=3, open_s=10.0, max_open_s=60.0), clock)


def test_it_opens_after_so_many_faults(breaker: CircuitBreaker, clock: Clock) -> None:
    """Two faults are borne, the third opens it; good answers in between make up for them."""
    for _ in range(2):
        breaker.fault("broken", "500")
    assert (breaker.state, breaker.refusal()) == ("closed", None)
    breaker.answered()
    for _ in range(2):
        breaker.fault("unreachable", "reset")
    assert breaker.state == "closed"
    breaker.fault("garbage", "7 samples")
    assert breaker.state == "open"
    assert (breaker.refusal() or "").endswith("7 samples")
    clock.now += 9.9
    assert breaker.state == "open"


def test_one_job_is_tried_when_it_is_half_open(breaker: CircuitBreaker, clock: Clock) -> None:
    """While it is on trial nothing else is; its fault opens the breaker for twice as long."""
    times_s = []
    for _ in range(5):
        while breaker.state != "open":
            breaker.fault("broken", "500")
        began = clock.now
        while breaker.refusal() is not None:
            clock.now += 1.0
        times_s.append(clock.now - began)
        assert breaker.state == "half-open"
        breaker.submitting()
        assert "on trial" in (breaker.refusal() or "")
        breaker.fault("broken", "500")
        assert breaker.state == "open"
        clock.now += 1.0
    # Each fault on trial doubles the time, the first fault after it finds it open already.
    assert times_s == [10.0, 19.0, 39.0, 59.0, 59.0]


def test_a_job_that_is_taken_is_on_probation(breaker: CircuitBreaker, clock: Clock) -> None:
    """A job taken closes it; the next fault opens it at once, a good answer clears it."""
    for _ in range(3):
        breaker.fault("broken", "500")
    clock.now += 10.0
    breaker.submitting()
    breaker.accepted()
    assert breaker.refusal() is None
    breaker.fault("garbage", "not binary")
    assert breaker.state == "open"
    clock.now += 20.0
    breaker.submitting()
    breaker.accepted()
    breaker.answered()
    for _ in range(2):
        breaker.fault("broken", "500")
    assert breaker.state == "closed"


@pytest.mark.parametrize(
    ("kind", "retry_s", "open_s"),
    [
        ("refused", None, 60.0),
        ("limited", 0.0, 10.0),
        ("limited", 5.0, 10.0),
        ("limited", 30.0, 30.0),
        ("limited", 7200.0, 7200.0),
        ("limited", None, 10.0),
        ("limited", float("inf"), 10.0),
        ("limited", float("nan"), 10.0),
        ("limited", -1.0, 10.0),
    ],
)
def test_some_faults_open_it_at_once(
    breaker: CircuitBreaker, clock: Clock, kind: str, retry_s: float | None, open_s: float
) -> None:
    """Refused credentials open it for longest, 429 as long as it says, if that can be believed, and
    at least as long as after other faults.
    """
    breaker.fault(kind, "no", retry_s)  # type: ignore[arg-type]
    clock.now += open_s - 0.5
    assert breaker.state == "open"
    clock.now += 0.5
    assert breaker.state == "half-open"


def test_faults_of_older_jobs_prolong_nothing(breaker: CircuitBreaker, clock: Clock) -> None:
    """Polls go on while it is open; their faults do not keep it open for ever."""
    for _ in range(3):
        breaker.fault("broken", "500")
    for _ in range(9):
        clock.now += 1.0
        breaker.fault("broken", "500")
    clock.now += 1.0
    assert breaker.state == "half-open"


def test_its_state_can_be_read_while_it_changes(clock: Clock) -> None:
    """Another thread that asks gets an answer, whatever the device's thread does meanwhile."""
    breaker = CircuitBreaker(
        JobLimits(fault_threshold=1, open_s=10.0, max_open_s=60.0), lambda: clock()
    )
    breaker.fault("broken", "500")
    clock.now += 11.0

    class Answering:
        """A clock during whose reading a good answer comes in."""

        def __call__(self) -> float:
            breaker.answered()
            return clock.now

    breaker._clock = Answering()
    assert breaker.state == "half-open"
    breaker._open_until = clock.now + 5.0
    assert (breaker.refusal() or "").startswith("breaker open until")
    assert breaker.state == "closed"

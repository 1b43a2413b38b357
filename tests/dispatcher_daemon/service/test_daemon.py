from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import pytest

from dispatcher_daemon import metrics
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import cycle_seed
from dispatcher_daemon.service.daemon import check_health
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.service.schedule import CycleScheduler
from dispatcher_daemon.service.store import PRUNE_BATCH
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import PoolJob, solve_in_process
from slipstream.messages import (
    CYCLE_KEY,
    CycleReport,
    DispatcherHealth,
    VehiclePlan,
    rsu_health_key,
    state_key,
)
from tests.dispatcher_daemon.service.feeds.states import health as rsu_health
from tests.dispatcher_daemon.service.logged import SETTINGS, Log, State, feed, make
from tests.dispatcher_daemon.service.waiting import wait_for


def test_a_cycle_is_stored_before_it_is_published(demo: RoutingProblem, state: State) -> None:
    """What vehicles are told is in the database first; plans come before the report."""
    log = Log()
    dispatcher = make(demo, log)
    feed(dispatcher, state, "avenue_east", 1)
    dispatcher.run_cycle()
    assert [key for key, _ in log.events] == [
        "stored",
        "slipstream/v1/fleet/van-a/plan",
        "slipstream/v1/fleet/van-b/plan",
        CYCLE_KEY,
    ]
    report, plans, states = log.events[0][1]  # type: ignore[misc]
    assert (report.cycle, report.status, report.plans) == (7, "ok", 2)
    assert tuple(log.published(VehiclePlan)) == plans
    assert [s.segment for s in states] == ["avenue_east"]
    assert any(s.platoon for p in plans for s in p.segments)
    dispatcher.run_cycle()
    assert [r.cycle for r in log.published(CycleReport)] == [7, 8]  # type: ignore[attr-defined]


def test_a_cycle_that_cannot_be_stored_sends_no_plan(
    demo: RoutingProblem, caplog: pytest.LogCaptureFixture
) -> None:
    """A database that fails costs the cycle, not the daemon; the bus is told, the log once."""
    log = Log(broken=True)
    dispatcher = make(demo, log)
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            dispatcher.run_cycle()
    assert [key for key, _ in log.events] == [CYCLE_KEY] * 3
    reports = log.published(CycleReport)
    assert [(r.cycle, r.status, r.plans, r.energy) for r in reports] == [  # type: ignore[attr-defined]
        (number, "failed", 0, None) for number in (7, 8, 9)
    ]
    assert "disk full" in reports[0].reason  # type: ignore[attr-defined]
    assert (dispatcher.delivery.cycles, dispatcher.delivery.failed) == (0, 3)
    (record,) = caplog.records
    assert "disk full" in record.message
    assert record.exc_info is None
    log.broken = False
    dispatcher.run_cycle()
    assert dispatcher.delivery.cycles == 1
    assert len(log.published(VehiclePlan)) == 2


def test_every_admitted_state_is_rolled_up(
    demo: RoutingProblem, state: State, caplog: pytest.LogCaptureFixture
) -> None:
    """States between two cycles count too, once each; a full disk delays their minutes."""
    log = Log()
    dispatcher = make(demo, log)
    old_ns = time.time_ns() - 120 * 10**9
    for sequence in range(5):
        seen = state("avenue_east", 1, time_ns=old_ns + sequence * 10**6, sequence=sequence)
        for _ in range(2):
            dispatcher.receiver.on_state(state_key(seen.rsu, seen.segment), seen.to_bytes())
    log.broken = True
    with caplog.at_level(logging.WARNING):
        dispatcher.run_cycle()
    assert "roll-ups could not be stored" in caplog.text
    assert log.rollups == []
    log.broken = False
    dispatcher.run_cycle()
    assert sum(part.count for part in log.rollups) == 5
    assert {part.segment for part in log.rollups} == {"avenue_east"}


def test_traffic_that_cannot_be_read_keeps_no_cycle(
    demo: RoutingProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Old cycles go all the same."""
    log = Log(old=60)
    monkeypatch.setattr(log, "tidy", lambda *_, **__: 1 / 0)
    dispatcher = make(demo, log)
    for _ in range(3):
        dispatcher.run_cycle()
    assert log.pruned == [50, 10, 0]


def test_a_cycle_that_raises_is_recorded_with_its_reason(demo: RoutingProblem) -> None:
    """Even a fault in our own code leaves a failed cycle behind, and the next one runs."""

    def broken(jobs: Sequence[PoolJob], deadline_s: float) -> list[object]:
        raise ZeroDivisionError("a bug")

    log = Log()
    dispatcher = make(demo, log, broken)  # type: ignore[arg-type]
    dispatcher.run_cycle()
    (report,) = log.published(CycleReport)
    assert isinstance(report, CycleReport)
    assert (report.status, report.reason) == ("failed", "ZeroDivisionError: a bug")
    assert log.published(VehiclePlan) == []
    assert (dispatcher.delivery.cycles, dispatcher.delivery.failed) == (1, 1)


def test_a_cycle_that_is_lost_before_it_begins_has_its_own_number(
    demo: RoutingProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device that cannot be told of the cycle; the next one has the number anew."""

    class Device:
        def begin_cycle(self, number: int) -> None:
            raise RuntimeError("gone")

    dispatcher = make(demo, Log())
    with monkeypatch.context() as patched:
        patched.setattr(dispatcher, "_job_manager", Device())
        dispatcher.run_cycle()
    lost = dispatcher.delivery.last
    assert lost is not None
    assert (lost.cycle, lost.status, lost.reason) == (7, "failed", "RuntimeError: gone")
    dispatcher.run_cycle()
    done = dispatcher.delivery.last
    assert done is not None
    assert (done.cycle, done.status) == (7, "ok")


def test_a_cycle_given_up_at_the_end_leaves_nothing(demo: RoutingProblem) -> None:
    """A dispatcher that is stopping publishes no plan made without its solvers."""
    log = Log()
    dispatcher = make(demo, log)
    dispatcher.delivery.stopping.set()
    dispatcher.run_cycle()
    assert log.events == []


def test_bad_messages_are_counted_and_logged_once(
    demo: RoutingProblem, state: State, caplog: pytest.LogCaptureFixture
) -> None:
    """Garbage, wrong types and wrong keys are survived, with one line for all of them."""
    log = Log()
    dispatcher = make(demo, log)
    key = state_key("rsu-avenue_east", "avenue_east")
    good = state("avenue_east", 1, time_ns=time.time_ns())
    with caplog.at_level(logging.WARNING):
        for payload in (b"", b"\xff\xfe", b"[]", b'{"rsu": 3}', good.to_bytes()[:-5]):
            dispatcher.receiver.on_state(key, payload)
        dispatcher.receiver.on_state(state_key("rsu-other", "avenue_east"), good.to_bytes())
    assert dispatcher.receiver.bad_messages == 6
    assert dispatcher.receiver.received == 0
    lines = [r.message for r in caplog.records]
    assert len(lines) == 1
    assert "not a SegmentState" in lines[0]
    dispatcher.receiver.on_state(key, good.to_bytes())
    assert dispatcher.receiver.received == 1


def test_an_rsus_health_is_kept_until_it_is_silent_for_a_day(
    demo: RoutingProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is none, or another RSU's, is counted; of strangers so many are kept, where none are
    listed, those heard last.
    """
    receiver = make(demo, Log()).receiver

    def tell(rsu: str) -> None:
        receiver.on_health(rsu_health_key(rsu), rsu_health(rsu).to_bytes())

    receiver.on_health(rsu_health_key("rsu-1"), b"{}")
    receiver.on_health(rsu_health_key("rsu-1"), rsu_health("rsu-2").to_bytes())
    assert (receiver.bad_messages, receiver.healths()) == (2, {})
    monkeypatch.setattr("dispatcher_daemon.service.dispatcher.receiver.MAX_RSUS", 2)
    for rsu in ("rsu-1", "rsu-2", "rsu-1", "rsu-3"):
        tell(rsu)
    assert set(receiver.healths()) == {"rsu-1", "rsu-3"}
    later_ns = time.time_ns() + 86_401 * 10**9
    monkeypatch.setattr(time, "time_ns", lambda: later_ns)
    assert receiver.healths() == {}
    settings = SETTINGS.model_copy(update={"rsus": {"rsu-1": ()}})
    receiver = Dispatcher(settings, demo.network, demo.fleet, Log(), Log(), print).receiver
    for rsu in ("rsu-1", "rsu-2"):
        tell(rsu)
    assert set(receiver.healths()) == {"rsu-1"}


def test_a_dispatcher_that_stood_still_says_it_of_itself(
    demo: RoutingProblem,
    state: State,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """In its health, its metrics and its log; the RSU has missed nothing."""
    log, now_s = Log(), 0.0
    dispatcher = make(demo, log)
    reception = dispatcher.receiver.latest.reception
    monkeypatch.setattr(reception, "_clock", lambda: now_s)
    for sequence, at_s in ((1, 0.0), (13, 12.0)):
        now_s = at_s
        seen = state("avenue_east", 1, sequence=sequence, time_ns=time.time_ns())
        dispatcher.receiver.on_state(state_key(seen.rsu, seen.segment), seen.to_bytes())
        dispatcher.health.publish(None)
    *_, health = log.published(DispatcherHealth)
    assert isinstance(health, DispatcherHealth)
    assert (health.stops, health.states_missed_here) == (1, 11)
    assert [rsu.missed for rsu in health.rsus] == [0]
    assert metrics.RECEPTION.own() == (1, 11)
    assert caplog.text.count("this dispatcher stood still") == 1


def test_health_and_watchdog_follow_the_cycles(demo: RoutingProblem, state: State) -> None:
    """Health carries the counters; a hanging cycle or a dead schedule is no progress."""
    log = Log()
    dispatcher = make(demo, log)
    feed(dispatcher, state, "avenue_east", 1)
    dispatcher.run_cycle()
    soon = time.time_ns() + 10**9
    dispatcher.health.publish(soon)
    (health,) = log.published(DispatcherHealth)
    assert isinstance(health, DispatcherHealth)
    assert (health.cycles, health.states_received, health.next_cycle_ns) == (1, 1, soon)
    assert (health.stale_after_s, health.future_tolerance_s) == (5.0, 1.0)
    assert health.rss_mb > 10
    assert dispatcher.is_live(soon)
    assert not dispatcher.is_live(None)
    assert not dispatcher.is_live(time.time_ns() - 120 * 10**9)
    assert not dispatcher.is_live(time.time_ns() + 3600 * 10**9)
    dispatcher.cycle_began = time.monotonic() - 3600
    assert not dispatcher.is_live(soon)


class FakeService:
    """Counts the watchdog's meals."""

    fed = 0

    def progress(self, status: str | None = None) -> None:
        """One more."""
        self.fed += 1


def test_the_look_each_second_follows_the_clock(demo: RoutingProblem) -> None:
    """A run that the clock has put an hour off is brought back before the watchdog is fed."""
    log, service = Log(), FakeService()
    dispatcher = make(demo, log)
    runs: list[int] = []
    scheduler = CycleScheduler(lambda: runs.append(1), SETTINGS.interval_s)
    scheduler.start()
    try:
        assert wait_for(lambda: len(runs) == 1)
        in_an_hour = datetime.now(UTC) + timedelta(hours=1)
        scheduler._scheduler.modify_job("cycle", next_run_time=in_an_hour)
        check_health(dispatcher, scheduler, service)  # type: ignore[arg-type]
        assert wait_for(lambda: len(runs) == 2)
    finally:
        scheduler.stop()
    (health,) = log.published(DispatcherHealth)
    assert isinstance(health, DispatcherHealth)
    assert health.next_cycle_ns is not None
    assert health.next_cycle_ns < time.time_ns() + 60 * 10**9
    assert service.fed == 1


@pytest.mark.attack
def test_a_state_of_an_unlisted_rsu_opens_no_gate_and_is_told(
    demo: RoutingProblem, state: State, caplog: pytest.LogCaptureFixture
) -> None:
    """Refusals are counted by verdict; one line of each kind names key and reason."""
    log = Log()
    settings = SETTINGS.model_copy(update={"rsus": {"rsu-avenue_east": ("avenue_east",)}})
    dispatcher = Dispatcher(
        settings, demo.network, demo.fleet, log, log, solve_in_process([ExactSolver()])
    )
    before = metrics.STATES.labels("unlisted")._value.get()
    with caplog.at_level(logging.WARNING):
        feed(dispatcher, state, "avenue_west", 1)
        feed(dispatcher, state, "avenue_west", 1)
        seen = state("avenue_east", 1, time_ns=time.time_ns(), speed_mps=-5.0)
        dispatcher.receiver.on_state(state_key(seen.rsu, seen.segment), seen.to_bytes())
    dispatcher.run_cycle()
    (report,) = log.published(CycleReport)
    assert not any(gate.open for gate in report.gates)  # type: ignore[attr-defined]
    assert dispatcher.receiver.refused == 3
    assert metrics.STATES.labels("unlisted")._value.get() == before + 2
    assert [record.getMessage() for record in caplog.records] == [
        "slipstream/v1/rsu/rsu-avenue_west/segment/avenue_west/state: state refused: unlisted",
        "slipstream/v1/rsu/rsu-avenue_east/segment/avenue_east/state: state refused: implausible, "
        "mean_speed_mps = -5",
    ]


def test_a_backlog_of_old_cycles_goes_bit_by_bit(demo: RoutingProblem) -> None:
    """Each cycle deletes a bounded number of old ones until none is left for this hour."""
    log = Log(old=2 * PRUNE_BATCH + 5)
    dispatcher = make(demo, log)
    for _ in range(5):
        dispatcher.run_cycle()
    assert log.pruned == [PRUNE_BATCH, PRUNE_BATCH, 5, 0]


def test_each_cycle_has_a_seed_of_its_own() -> None:
    """Seeds are reproducible and differ from cycle to cycle and from run to run."""
    assert cycle_seed(1, 5) == cycle_seed(1, 5)
    assert len({cycle_seed(s, c) for s in range(5) for c in range(5)}) == 25

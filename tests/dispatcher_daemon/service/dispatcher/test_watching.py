"""From what happens to a dispatcher to its alarms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.alarms import KINDS, AlarmKind
from dispatcher_daemon.service.dispatcher import AlarmSource, Dispatcher
from slipstream.messages import Alarms, rsu_health_key
from tests.dispatcher_daemon.service.feeds.states import health as rsu_health
from tests.dispatcher_daemon.service.logged import SETTINGS, Log, make


def kinds(log: Log) -> list[str]:
    """Of the alarms in force, as they were published last."""
    told = log.published(Alarms)[-1]
    assert isinstance(told, Alarms)
    return [alarm.kind for alarm in told.alarms if alarm.ended_ns is None]


@pytest.fixture
def watched(demo: RoutingProblem) -> tuple[Log, Dispatcher, AlarmSource, list[tuple[str, Any]]]:
    """A dispatcher whose alarms are watched, and what callers were told."""
    log, told = Log(), list[tuple[str, Any]]()
    dispatcher = make(demo, log)

    def announce(kind: str, value: Any) -> None:
        told.append((kind, value))

    source = AlarmSource(dispatcher, SETTINGS, demo.network, log, log, announce)
    return log, dispatcher, source, told


def test_a_cycle_that_could_not_be_stored_is_told_until_one_is(watched: Any) -> None:
    """Though the database could be opened again at once."""
    log, dispatcher, source, told = watched
    dispatcher.run_cycle()
    source.update()
    assert kinds(log) == []
    log.broken = True
    dispatcher.run_cycle()
    log.broken = False
    source.update()
    assert kinds(log) == ["database_fault"]
    dispatcher.run_cycle()
    source.update()
    assert kinds(log) == []
    assert [(kind, alarm.ended_ns is None) for kind, alarm in told] == [
        ("alarm", True),
        ("alarm", False),
    ]


def test_a_cycle_that_fails_and_a_pause_are_told(
    watched: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each ends with its cause."""
    log, dispatcher, source, _ = watched

    def broken(*_: object) -> None:
        raise ValueError("boom")

    with monkeypatch.context() as patch:
        patch.setattr("dispatcher_daemon.service.dispatcher.runner.run_cycle", broken)
        dispatcher.run_cycle()
    source.update()
    assert kinds(log) == ["cycle_failed"]
    dispatcher.control.pause("ada")
    source.update()
    assert kinds(log) == ["cycle_failed", "paused"]
    dispatcher.control.resume("ada")
    dispatcher.run_cycle()
    source.update()
    assert kinds(log) == []


def test_a_fault_in_it_stops_nothing(
    watched: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It is logged, and the next look finds what there is."""
    log, _, source, _ = watched

    def broken(*_: object) -> Any:
        raise RuntimeError("boom")

    with monkeypatch.context() as patch:
        patch.setattr(source, "_facts", broken)
        source.update()
    assert "alarms could not be brought up to date: boom" in caplog.text
    source.update()
    assert kinds(log) == []


def test_rsus_are_heard(watched: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their own words are alarms as soon as they last; one fault of the bus is one alarm."""
    log, dispatcher, source, _ = watched
    health = rsu_health("a", segments=(), status="no_signal")
    dispatcher.receiver.on_health(rsu_health_key("a"), health.to_bytes())
    source.update()
    assert kinds(log) == []
    at_once = replace(KINDS["rsu_no_signal"], raise_after_s=0.0)
    monkeypatch.setitem(cast(dict[str, AlarmKind], KINDS), "rsu_no_signal", at_once)
    source.update()
    assert kinds(log) == ["rsu_no_signal"]
    lost = replace(KINDS["bus_lost"], raise_after_s=0.0)
    monkeypatch.setitem(cast(dict[str, AlarmKind], KINDS), "bus_lost", lost)
    monkeypatch.setattr(source, "_bus_fault", lambda: "no router answers")
    monkeypatch.setattr(source.roadside, "_silent_ns", -1.0)  # all are silent now
    source.update()
    assert kinds(log) == ["bus_lost", "rsu_no_signal"]
    monkeypatch.setattr(source, "_bus_fault", lambda: None)
    source.update()
    assert kinds(log) == ["bus_lost", "rsu_no_signal"]
    monkeypatch.setattr("dispatcher_daemon.service.dispatcher.watching.RECONNECTED_S", 0.0)
    source.update()
    assert set(kinds(log)) == {"bus_lost", "rsu_silent", "rsu_no_signal"}

"""Counts of quarter hours: who may tell them, what is possible, and that each is stored once."""

from __future__ import annotations

import time
from typing import Any

import msgspec
import pytest

from dispatcher_daemon import metrics
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.dispatcher.receiver import StateReceiver
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.messages import Estimate, SegmentCounts, counts_key
from slipstream.roads.admission import refusal
from storage import StorageError
from tests.dispatcher_daemon.service.feeds.states import NOW_NS, counts

QUARTER_NS = 900 * 10**9


class Store:
    """A database that may be away."""

    def __init__(self) -> None:
        self.stored: list[SegmentCounts] = []
        self.away = False

    def add_counts(self, quarter_hours: list[SegmentCounts]) -> None:
        if self.away:
            raise StorageError("busy")
        self.stored += quarter_hours


@pytest.fixture
def receiver(demo: RoutingProblem, monkeypatch: pytest.MonkeyPatch) -> StateReceiver:
    """Of a dispatcher that lists one RSU, at the time of the counts."""
    monkeypatch.setattr(time, "time_ns", lambda: NOW_NS)
    settings = DispatcherSettings(rsus={"rsu-1": ("avenue_east",)})
    return StateReceiver(demo.network, settings, lambda *_: None)


def tell(receiver: StateReceiver, told: SegmentCounts, key: str | None = None) -> None:
    """Hand one to the receiver."""
    receiver.on_counts(key or counts_key(told.rsu, told.segment), told.to_bytes())


def test_complete_counts_are_kept_and_stored_with_the_next_cycle(receiver: StateReceiver) -> None:
    """What cannot be stored is tried again; of each road the latest quarter hour is known."""
    store = Store()
    tell(receiver, counts())
    tell(receiver, counts(quarters_ago=1))
    assert receiver.counts() == (counts(),)
    store.away = True
    receiver.store_rollups(store)  # type: ignore[arg-type]
    store.away = False
    receiver.store_rollups(store)  # type: ignore[arg-type]
    receiver.store_rollups(store)  # type: ignore[arg-type]
    assert store.stored == [counts(), counts(quarters_ago=1)]


@pytest.mark.parametrize(
    "told",
    [
        counts("avenue_west"),
        counts(rsu="stranger"),
        counts("nowhere"),
        counts(quarters_ago=-1),
        counts(quarters_ago=97),
        counts(watched_s=1000.0),
        counts(watched_s=1.0),
    ],
    ids=["not its road", "a stranger", "no road", "ahead", "of yesterday", "too long", "too many"],
)
def test_what_an_rsu_may_not_say_is_refused(receiver: StateReceiver, told: SegmentCounts) -> None:
    """It is counted, and neither known nor stored."""
    before = metrics.COUNTS.labels("refused")._value.get()
    tell(receiver, told)
    assert metrics.COUNTS.labels("refused")._value.get() == before + 1
    store = Store()
    receiver.store_rollups(store)  # type: ignore[arg-type]
    assert (receiver.counts(), store.stored) == ((), [])


def test_what_is_no_such_message_is_counted_as_bad(receiver: StateReceiver) -> None:
    """Noise, another road's key, and a quarter hour that still runs."""
    receiver.on_counts(counts_key("rsu-1", "avenue_east"), b"noise")
    tell(receiver, counts(), counts_key("rsu-1", "avenue_west"))
    tell(receiver, msgspec.structs.replace(counts(), complete=False))
    assert receiver.bad_messages == 3
    assert receiver.counts() == ()


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"vehicles": Estimate(value=121.0)}, "other classes"),
        ({"vehicles": Estimate(value=-1.0)}, "-1 vehicles"),
        ({"vehicles": Estimate(value=120.0, standard_error=1e9)}, "standard error"),
        ({"classes": (counts().classes[0],) * 2}, "a class twice"),
        ({"mean_speed_mps": Estimate(value=69.0)}, "mean_speed_mps = 69"),
        ({"mean_speed_mps": Estimate(value=-1.0)}, "mean_speed_mps = -1"),
        ({"v85_mps": Estimate(value=90.0)}, "v85_mps = 90"),
        ({"speeds": 121}, "more speeds"),
        ({"watched_s": 902.0}, "902 s watched in 900 s"),
    ],
)
def test_what_is_physically_impossible_is_told(
    demo: RoutingProblem, changed: dict[str, Any], what: str
) -> None:
    """In one line for people."""
    assert refusal(counts(), demo.network, None) is None
    refused = refusal(msgspec.structs.replace(counts(), **changed), demo.network, None)
    assert refused is not None
    assert what in refused.text

"""Counted vehicles on a road's card: the last quarter hour, how sure, how old, or why not."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from dashboard.live import LiveData, Snapshot
from dashboard.web.routes.count_parts import RUNNING_FRESH_S, counts
from dashboard.web.tables.rows import Known
from slipstream.errors import InputError
from slipstream.freshness import COUNTS_FRESH_S
from slipstream.messages import Estimate, SegmentCounts, counts_key, running_counts_key
from slipstream.roads.admission import refusal
from slipstream.roads.sumo_net import load_network
from tests.dispatcher_daemon.service.feeds.states import counts as complete

QUARTER_NS = 900 * 10**9
WHOLE = complete()
END_NS = WHOLE.until_ns


def running(watched_s: float = 290.0, **changed: Any) -> SegmentCounts:
    """Five minutes of the next quarter hour."""
    told = {
        "began_ns": END_NS,
        "until_ns": END_NS + 300 * 10**9,
        "complete": False,
        "watched_s": watched_s,
        "reason": None,
    }
    return msgspec.structs.replace(WHOLE, **{**told, **changed})


def card(
    now_ns: int, *told: SegmentCounts, stored: tuple[SegmentCounts, ...] = ()
) -> dict[str, Any] | None:
    """The card's part at a time."""
    snapshot = Snapshot(
        counts={(one.segment, one.rsu): one for one in told if one.complete},
        running_counts={(one.segment, one.rsu): one for one in told if not one.complete},
    )
    return counts("avenue_east", Known(snapshot, {}, now_ns), stored)


def test_the_last_quarter_hour_is_shown_with_its_errors() -> None:
    """Flow of each class in vehicles an hour of watched time, and speeds in km/h."""
    part = card(END_NS + 60 * 10**9, WHOLE, running())
    assert part is not None
    assert part["complete"]
    assert (part["begin"], part["end"]) == ((END_NS - QUARTER_NS) // 10**6, END_NS // 10**6)
    assert part["watched_share"] == 0.667
    assert part["why"] == "the camera's picture is black"
    assert [(flow["kind"], flow["vph"]) for flow in part["flows"]] == [
        ("all", 720.0),
        ("car", 600.0),
        ("truck", 96.0),
        ("bus", 24.0),
        ("motorcycle", 0.0),
    ]
    assert part["flows"][0]["standard_error"] == 42.0
    assert part["kmh"] == {"value": 43.2, "standard_error": 0.43}
    assert part["v85_kmh"] == {"value": 50.4, "standard_error": 0.76}


def test_until_the_first_one_is_complete_the_running_one_is_shown() -> None:
    """Also where the last one is too old, or could not be watched."""
    now_ns = END_NS + 310 * 10**9
    unwatched = msgspec.structs.replace(
        WHOLE, watched_s=10.0, vehicles=Estimate(value=0.0), classes=(), speeds=0
    )
    old = complete(quarters_ago=1)
    for told in ((running(),), (running(), unwatched), (running(), old)):
        part = card(now_ns, *told)
        assert part is not None
        assert not part["complete"]


def test_what_is_old_or_of_another_road_is_not_shown() -> None:
    """Then the page says that nothing was told."""
    old_ns = END_NS + round((COUNTS_FRESH_S + 1) * 1e9)
    assert card(old_ns, WHOLE) is None
    told = running()
    assert card(told.until_ns + round((RUNNING_FRESH_S + 1) * 1e9), told) is None
    assert card(END_NS, complete("avenue_west")) is None
    assert card(END_NS - 60 * 10**9, WHOLE) is None


@pytest.mark.parametrize(
    ("reason", "why"),
    [
        ("dark", "the camera's picture is black"),
        ("not_running", "the roadside unit had not started yet"),
        (None, "watched for less than 60 s until now"),
    ],
)
def test_where_nothing_can_be_told_it_says_why(reason: Any, why: str) -> None:
    """There is no flow, and a reason."""
    told = running(watched_s=30.0, reason=reason)
    part = card(told.until_ns, told)
    assert part is not None
    assert (part["flows"], part["why"]) == ([], why)


def test_of_two_units_that_which_watched_for_longer_tells() -> None:
    """Both watch the same road."""
    other = complete(rsu="rsu-2", watched_s=880.0)
    part = card(END_NS, WHOLE, other)
    assert part is not None
    assert part["watched_share"] == 0.978


def test_a_past_moment_has_what_is_stored() -> None:
    """The quarter hour that was over then."""
    part = card(END_NS + 60 * 10**9, stored=(complete(quarters_ago=1), WHOLE))
    assert part is not None
    assert part["end"] == END_NS // 10**6


def test_counts_are_admitted_as_states_are() -> None:
    """Not those of an unlisted unit, nor under the key of the running ones."""
    network = load_network("demo")
    rsus = {"rsu-1": ("avenue_east",)}
    live = LiveData(lambda: END_NS, lambda message: refusal(message, network, rsus))
    for told, key in (
        (complete(rsu="rsu-2"), counts_key("rsu-2", "avenue_east")),
        (WHOLE, running_counts_key("rsu-1", "avenue_east")),
        (running(), counts_key("rsu-1", "avenue_east")),
    ):
        with pytest.raises(InputError, match=r"refused|belongs under"):
            live.on_counts(key, told.to_bytes())
    live.on_counts(counts_key("rsu-1", "avenue_east"), WHOLE.to_bytes())
    older = complete(quarters_ago=1)
    live.on_counts(counts_key("rsu-1", "avenue_east"), older.to_bytes())
    live.on_counts(running_counts_key("rsu-1", "avenue_east"), running().to_bytes())
    snapshot = live.snapshot()
    assert snapshot.counts == {("avenue_east", "rsu-1"): WHOLE}
    assert snapshot.running_counts == {("avenue_east", "rsu-1"): running()}

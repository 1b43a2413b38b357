"""Orders wait for others, so that one vehicle takes several; urgent ones for less."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dispatcher_daemon.fleet.tracking import FleetTracker, bundled_until_ns
from dispatcher_daemon.fleet.tracking.order_stops import is_bundled
from dispatcher_daemon.forms.problem import RoutingProblem

from .conftest import request

S = 10**9
NOW_NS = 1_800_000_000 * S
"""A multiple of 300 s."""


@pytest.mark.parametrize(
    ("received_s", "latest_s", "until_s"),
    [
        (0, None, 0),
        (1, None, 300),
        (299, None, 300),
        (301, None, 600),
        (1, 1201, 300),
        (1, 401, 101),
        (1, 1, 1),
        (1, 0, 1),
    ],
)
def test_an_order_waits_for_the_next_multiple_or_a_quarter_of_its_slack(
    received_s: int, latest_s: int | None, until_s: int
) -> None:
    """Whichever comes first; one whose window closes does not wait."""
    latest_ns = None if latest_s is None else NOW_NS + latest_s * S
    until_ns = bundled_until_ns(NOW_NS + received_s * S, latest_ns, 300.0)
    assert (until_ns - NOW_NS) / S == until_s
    assert bundled_until_ns(NOW_NS, latest_ns, 0.0) == NOW_NS


@pytest.fixture
def tracker(district: RoutingProblem) -> FleetTracker:
    """It heard of three orders 20, 10 and 5 s after a multiple; one has a window of 40 s."""
    found = FleetTracker(district.network, bundle_s=300.0)
    found.list_fleet(district.fleet, NOW_NS)
    found.book.submit(request("first"), "11", NOW_NS + 20 * S)
    found.book.submit(request("second"), "11", NOW_NS + 10 * S)
    urgent = request("urgent", latest=NOW_NS + 45 * S)
    found.book.submit(urgent, "11", NOW_NS + 5 * S)
    return found


def planned(tracker: FleetTracker, district: RoutingProblem, after_s: float) -> set[str]:
    """Callers' orders that a cycle may plan."""
    situation = tracker.situation(district.fleet, 1, NOW_NS + round(after_s * S), 0.0)
    assert situation.fleet is not None
    return {stop.id for stop in situation.fleet.stops} & {"first", "second", "urgent"}


def test_orders_that_come_within_a_time_are_planned_together(
    tracker: FleetTracker, district: RoutingProblem
) -> None:
    """The urgent one is sooner; none of them is called waiting for a vehicle meanwhile."""
    assert planned(tracker, district, 14.9) == set()
    assert tracker.unplanned["first"].startswith("others may join it: it is planned from 2027-01-")
    situation = tracker.situation(district.fleet, 1, NOW_NS + 20 * S, 0.0)
    assert {"first", "second"} <= set(situation.later)
    assert not situation.waiting
    assert planned(tracker, district, 15.0) == {"urgent"}
    assert planned(tracker, district, 40.0) == {"urgent"}
    assert planned(tracker, district, 300.0) == {"first", "second"}


def test_no_idle_vehicle_is_sent_for_an_order_that_may_wait(
    tracker: FleetTracker, district: RoutingProblem
) -> None:
    """Between cycles it is put into tours only that have stops already."""

    def tours(*orders: str) -> int:
        found, _ = tracker.insertion(district.fleet, orders, 1, NOW_NS + 20 * S, 0.0)
        return len(found)

    assert tours("first") == tours("first", "second") == 0
    assert tours("urgent") == len(district.fleet.vehicles)
    assert tours("first", "urgent") == len(district.fleet.vehicles)


def test_an_order_that_a_vehicle_has_waits_for_nobody(tracker: FleetTracker) -> None:
    """As of a tour that it was put into before its time."""
    order = tracker.book.orders["first"]
    assert is_bundled(order, NOW_NS + 25 * S, 300.0)
    assert not is_bundled(replace(order, state="planned"), NOW_NS + 25 * S, 300.0)

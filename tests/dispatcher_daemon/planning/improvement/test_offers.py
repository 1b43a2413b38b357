"""Meetings that were on offer in a block and not taken."""

from __future__ import annotations

import pytest

from dispatcher_daemon.forms.problem import RouteOption, RouteProblem
from dispatcher_daemon.planning.improvement.blocks import Block
from dispatcher_daemon.planning.improvement.offers import declined_meetings
from dispatcher_daemon.planning.routes.itineraries import Itinerary

NAMES = {0: "van-a", 1: "van-b"}


def itinerary(number: int, cost_kwh: float, entry_s: float | None, stop: str = "c") -> Itinerary:
    """One that passes the road at a moment, or not at all."""
    passages = {} if entry_s is None else {"road": [(entry_s, entry_s + 9.0, (number,))]}
    return Itinerary(number, (f"{stop}{number}",), None, cost_kwh, passages)


def block(saving_kwh: float, entry_s: float = 11.0, stop: str = "c") -> Block:
    """Two vans that could both take the road, for 0.2 and 0.3 kWh more."""
    options = {
        0: [itinerary(0, 1.0, None), itinerary(0, 1.2, 10.0)],
        1: [itinerary(1, 2.0, None), itinerary(1, 2.3, entry_s, stop)],
    }
    every = tuple(
        RouteOption(NAMES[n], (), option.cost_kwh) for n, of in options.items() for option in of
    )
    return Block(options, RouteProblem(("van-a", "van-b"), (), every, {(1, 3): saving_kwh}))


def test_a_meeting_that_costs_more_than_it_saves_is_told_with_both_figures() -> None:
    """By the ways that the two would take for it."""
    offered = block(0.1)
    (one,) = declined_meetings(offered, [offered.options[n][0] for n in (0, 1)], NAMES, 3.0)
    assert (one.vehicles, one.segments) == (("van-a", "van-b"), ("road",))
    assert one.cost_kwh == pytest.approx(0.5)
    assert one.saving_kwh == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("offered", "taken"),
    [
        (block(0.1), 1),
        (block(0.6), 0),
        (block(0.1, entry_s=14.0), 0),
        (block(0.1, stop="d"), 0),
    ],
    ids=["taken", "worth it", "not together", "other stops"],
)
def test_what_was_taken_or_is_no_such_meeting_is_not_told(offered: Block, taken: int) -> None:
    """Taken, or worth it by the block's estimate and not by the exact one; not together; or of
    other stops, so that the cost is no cost of the meeting alone.
    """
    present = [offered.options[n][taken] for n in (0, 1)]
    assert list(declined_meetings(offered, present, NAMES, 3.0)) == []

"""What is told of signals is known as long as it is fresh, and no longer."""

from __future__ import annotations

import math

import pytest

from tests.vehicle_agent.road import course, crossing, leg, segment, spat, timings
from vehicle_agent.signals import Green, Indication, intersections_ahead

GREEN = "protected-Movement-Allowed"
YIELDING = "permissive-Movement-Allowed"
YELLOW = "protected-clearance"
RED = "stop-And-Remain"


def test_fixed_greens_are_certain_and_open_ones_are_not() -> None:
    """Of a fixed program all greens; of an actuated one the first, and nothing behind it."""
    fixed = timings(spat(10.0, *course((0.0, 20.0), (60.0, 80.0))))
    assert fixed.upcoming("signal", 3, 10.0) == (
        Green(0.0, 20.0, True, True),
        Green(60.0, 80.0, True, True),
    )
    actuated = timings(
        spat(10.0, (GREEN, 0.0, 15.0, None), (RED, 15.0, 40.0, None), (GREEN, 40.0, 45.0, None))
    )
    assert actuated.upcoming("signal", 3, 10.0) == (Green(0.0, 15.0, False, True),)
    later = timings(spat(10.0, (RED, 0.0, 30.0, None), (GREEN, 30.0, 35.0, 35.0)))
    assert later.upcoming("signal", 3, 10.0) == (Green(30.0, 35.0, False, True),)


def test_greens_in_a_row_are_one() -> None:
    """It is protected only if it is so all the time."""
    told = timings(spat(0.0, (YIELDING, 0.0, 9.0, 9.0), (GREEN, 9.0, 20.0, 20.0)))
    assert told.upcoming("signal", 3, 0.0) == (Green(0.0, 20.0, True, False),)


@pytest.mark.parametrize(
    ("now_s", "known"), [(99.8, False), (99.9, True), (102.0, True), (102.1, False)]
)
def test_a_message_counts_for_two_seconds(now_s: float, known: bool) -> None:
    """Older ones, and those dated ahead of the clock by more than 0.1 s, count as not known."""
    told = timings(spat(100.0, (GREEN, 90.0, 120.0, 120.0)))
    assert bool(told.upcoming("signal", 3, now_s)) == known
    assert bool(told.predicted("signal", 3, now_s, 600.0)) == known
    assert (told.indication("signal", 3, now_s) is not None) == known


def test_other_signals_and_groups_are_not_known() -> None:
    """Nor is what an intersection does not tell of."""
    told = timings(spat(0.0, (GREEN, 0.0, 20.0, 20.0)))
    assert told.upcoming("other", 3, 0.0) == told.upcoming("signal", 4, 0.0) == ()
    assert told.indication("other", 3, 0.0) is told.indication("signal", 4, 0.0) is None


def test_an_older_message_changes_nothing_and_a_newer_one_replaces() -> None:
    """Messages may arrive in another order."""
    told = timings(
        spat(2.0, (GREEN, 0.0, 20.0, 20.0)),
        spat(1.0, (RED, 0.0, 20.0, 20.0)),
        spat(2.0, (RED, 0.0, 20.0, 20.0)),
    )
    assert told.upcoming("signal", 3, 2.0)
    told.receive(spat(3.0, (RED, 0.0, 20.0, 20.0)))
    assert told.upcoming("signal", 3, 3.0) == ()


def test_the_same_content_of_a_new_date_stays_fresh() -> None:
    """A repeated message need not be converted again."""
    first = spat(0.0, (GREEN, 0.0, 20.0, 20.0))
    told = timings(first)
    told.receive(first.model_copy(update={"time_ns": 5_000_000_000}))
    assert told.upcoming("signal", 3, 5.0) == (Green(0.0, 20.0, True, True),)


def test_what_shows_follows_the_clock() -> None:
    """Between messages the phases of fixed times go on as told."""
    told = timings(spat(19.0, *course((0.0, 20.0), (60.0, 80.0))))
    assert told.indication("signal", 3, 19.9) == Indication(True, False, 23.0)
    assert told.indication("signal", 3, 20.0) == Indication(False, True, 23.0)
    told = timings(spat(22.0, *course((0.0, 20.0), (60.0, 80.0))))
    assert told.indication("signal", 3, 23.5) == Indication(False, False, 23.0)


def test_a_green_is_not_known_beyond_its_earliest_end() -> None:
    """Unless a message has just told that it goes on; a red lasts until told otherwise."""
    green = timings(spat(10.0, (GREEN, 0.0, 10.5, None), (YELLOW, 10.5, 13.5, None)))
    assert green.indication("signal", 3, 10.4) == Indication(True, False, math.inf)
    assert green.indication("signal", 3, 10.5) is None
    held = timings(spat(11.0, (GREEN, 0.0, 10.5, None), (YELLOW, 10.5, 13.5, None)))
    assert held.indication("signal", 3, 11.0) == Indication(True, False, math.inf)
    red = timings(spat(10.0, (RED, 0.0, 10.5, None), (GREEN, 10.5, 20.0, None)))
    assert red.indication("signal", 3, 11.9) == Indication(False, False, 0.0)


def test_a_dark_signal_is_not_known() -> None:
    """The rules of the road hold there."""
    told = timings(spat(0.0, ("dark", 0.0, 20.0, None)))
    assert told.indication("signal", 3, 0.0) is None
    assert told.upcoming("signal", 3, 0.0) == ()


def test_fixed_times_that_repeat_are_foreseen() -> None:
    """Also two greens a cycle, also with the first one begun or ended; others are as told."""
    told = timings(spat(10.0, *course((5.0, 20.0), (80.0, 100.0), (160.0, 180.0))))
    foreseen = told.predicted("signal", 3, 10.0, 300.0)
    assert [green.begin_s for green in foreseen] == [5.0, 80.0, 160.0, 240.0, 320.0]
    double = course((10.0, 20.0), (40.0, 45.0), (90.0, 100.0), (120.0, 125.0))
    begins = [g.begin_s for g in timings(spat(0.0, *double)).predicted("signal", 3, 0.0, 230.0)]
    assert begins == [10.0, 40.0, 90.0, 120.0, 170.0, 200.0, 250.0, 280.0]
    ended = timings(spat(20.0, *course((0.0, 20.0), (80.0, 100.0))))
    assert len(ended.predicted("signal", 3, 20.0, 300.0)) == 4
    uneven = timings(spat(0.0, *course((10.0, 20.0), (60.0, 75.0))))
    assert len(uneven.predicted("signal", 3, 0.0, 600.0)) == 2


def test_the_intersections_that_matter_lie_ahead_and_near() -> None:
    """Each once, the nearest first."""
    road = leg(
        segment("a", 100.0, onward=crossing(groups=((0, 1),), intersection="one")),
        segment("b", 100.0, onward=crossing(groups=((0, 1),), intersection="two")),
        segment("c", 100.0, onward=crossing(groups=((0, 4),), intersection="one")),
        segment("d", 900.0, onward=crossing(groups=((0, 1),), intersection="far")),
        segment("e", 100.0),
    )
    assert intersections_ahead(road, 0.0) == ("one", "two")
    assert intersections_ahead(road, 100.0) == ("two", "one")
    assert intersections_ahead(road, 0.0, road.length_m) == ("one", "two", "far")

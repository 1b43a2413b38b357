"""Platoon metres of plans: each plan replaces what the one before had of the time after it."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.tests.simulation.fleet.road import LENGTHS, ns, plan, segments
from slipstream.energy.consumption import ETA_FOLLOWER, ETA_LEADER, drag_saving_kwh
from slipstream.messages import VehiclePlan
from slipstream_lab.simulation.closed_loop.planned_platoons import PlannedPlatoons


def timed(
    path: str, entries_s: Sequence[float], place: int | None = 1, vehicle: str = "van"
) -> VehiclePlan:
    """A plan whose segments are entered then."""
    planned = [
        segment.model_copy(update={"entry_ns": ns(entry_s)})
        for segment, entry_s in zip(segments(path, 0, place), entries_s, strict=True)
    ]
    return plan(planned, vehicle=vehicle)


def test_metres_of_all_members_are_added() -> None:
    """Those of vehicles alone are none."""
    platoons = PlannedPlatoons()
    platoons.add(timed("ab", (10, 110), place=0, vehicle="one"), ns(0))
    platoons.add(timed("ab", (11, 111), vehicle="two"), ns(0))
    platoons.add(timed("abc", (10, 110, 160), place=None, vehicle="three"), ns(0))
    assert platoons.planned_m == 2 * (LENGTHS["a"] + LENGTHS["b"])


def test_what_drafting_saves_goes_by_place() -> None:
    """A leader's reduction for the first, a follower's for those behind it, at planned speeds."""
    platoons = PlannedPlatoons()
    platoons.add(timed("a", (10,), place=0, vehicle="one"), ns(0))
    (segment,) = timed("a", (10,)).segments
    led = drag_saving_kwh(LENGTHS["a"], segment.speed_mps, ETA_LEADER)
    assert platoons.saved_kwh == pytest.approx(led)
    platoons.add(timed("a", (11,), place=1, vehicle="two"), ns(0))
    both = led + drag_saving_kwh(LENGTHS["a"], segment.speed_mps, ETA_FOLLOWER)
    assert platoons.saved_kwh == pytest.approx(both)
    platoons.add(timed("a", (12,), place=None, vehicle="one"), ns(5))
    assert platoons.saved_kwh == pytest.approx(both - led)


def test_what_a_plan_promises_counts() -> None:
    """Where a platoon is expected to be close on a quarter of its segment, that is planned."""
    whole, quarter = PlannedPlatoons(), PlannedPlatoons()
    told = timed("ab", (10, 110))
    first = told.segments[0].model_copy(update={"drafting_share": 0.25})
    whole.add(told, ns(0))
    quarter.add(told.model_copy(update={"segments": (first, *told.segments[1:])}), ns(0))
    assert quarter.planned_m == pytest.approx(whole.planned_m - 0.75 * LENGTHS["a"])
    lost_kwh = 0.75 * drag_saving_kwh(LENGTHS["a"], first.speed_mps, ETA_FOLLOWER)
    assert quarter.saved_kwh == pytest.approx(whole.saved_kwh - lost_kwh)


def test_a_later_plan_replaces_what_was_to_come() -> None:
    """What was entered before it stays; the rest is what the newer plan says."""
    platoons = PlannedPlatoons()
    platoons.add(timed("abc", (10, 110, 160)), ns(0))
    platoons.add(timed("bc", (112, 165), place=None), ns(100))
    assert platoons.planned_m == LENGTHS["a"]
    platoons.add(timed("c", (170,)), ns(120))
    assert platoons.planned_m == LENGTHS["a"] + LENGTHS["c"]


def test_what_another_vehicle_is_sent_changes_nothing() -> None:
    """Plans are replaced by vehicle."""
    platoons = PlannedPlatoons()
    platoons.add(timed("a", (10,), vehicle="one"), ns(0))
    platoons.add(timed("b", (10,), vehicle="two", place=None), ns(5))
    assert platoons.planned_m == LENGTHS["a"]


@given(st.lists(st.tuples(st.sampled_from(["a", "ab", "abc"]), st.booleans()), max_size=6))
def test_the_same_plan_again_adds_nothing(plans: list[tuple[str, bool]]) -> None:
    """Nor is a sum ever negative, or above what all plans have together."""
    platoons, most_m = PlannedPlatoons(), 0.0
    for cycle, (path, together) in enumerate(plans):
        entries_s = [300.0 * cycle + 100.0 * n + 10.0 for n in range(len(path))]
        told = timed(path, entries_s, place=1 if together else None)
        platoons.add(told, ns(300.0 * cycle))
        before_m = platoons.planned_m
        platoons.add(told, ns(300.0 * cycle))
        assert platoons.planned_m == before_m
        most_m += sum(LENGTHS[name] for name in path) if together else 0.0
        assert 0.0 <= platoons.planned_m <= most_m

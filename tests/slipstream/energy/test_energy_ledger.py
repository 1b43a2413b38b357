"""Parts of plans between two places on their ways, against sums by hand."""

from __future__ import annotations

from dataclasses import astuple
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipstream.energy.ledger import HOUR_NS, EnergyHour, PlanEnergy, driven, merged, replaced_at
from slipstream.messages import PlannedSegment, PlannedStop, VehiclePlan

S = 10**9
BEGIN_NS = 500_000 * HOUR_NS
LENGTHS_M = (1000.0, 500.0, 250.0, 250.0)
ENERGY = PlanEnergy((0.4, 0.2, -0.1, 0.3), (0.0, 0.1, 0.0, 0.0), 0.8, -0.4, 0.5)


def make_plan(first: int = 0, begins_ns: int = BEGIN_NS, leg: int = 0) -> VehiclePlan:
    """A plan over stop a, with legs of two segments; a later one begins on one of its segments."""
    stops = [
        PlannedStop(stop=name, node="n", arrival_ns=BEGIN_NS, departure_ns=BEGIN_NS)
        for name in ("depot", "a", "depot")[leg:]
    ]
    segments = tuple(
        PlannedSegment(
            segment=f"e{number}",
            entry_ns=begins_ns + (number - first) * 1200 * S,
            exit_ns=begins_ns + (number - first + 1) * 1200 * S,
            speed_mps=10.0,
            platoon="p" if number == 1 else None,
            place=0 if number == 1 else None,
            gap_m=None,
            drafting_share=0.5 if number == 1 else None,
            leg=number // 2 - leg,
            length_m=LENGTHS_M[number],
        )
        for number in range(first, 4)
    )
    return VehiclePlan(
        vehicle="van",
        cycle=1,
        issued_ns=begins_ns,
        valid_until_ns=begins_ns,
        depart_ns=begins_ns,
        stops=tuple(stops),
        segments=segments,
        distance_m=2000.0,
        energy_kwh=0.8,
    )


def total(parts: list[EnergyHour]) -> tuple[float, ...]:
    """All figures of all parts together."""
    return tuple(map(sum, zip(*(astuple(part)[2:] for part in parts), strict=True)))


def test_a_whole_plan_is_its_energy() -> None:
    """All segments, with what is saved, by hours; of the first one only what lay ahead."""
    parts = list(driven(make_plan(), ENERGY, 0.0, 4.0, BEGIN_NS + 9 * HOUR_NS))
    assert total(parts) == pytest.approx((1.3, 0.8, 0.8, 0.1, -0.4, 1500.0, 250.0))
    hours = merged(parts)
    assert [hour.hour_ns - BEGIN_NS for hour in hours] == [0, HOUR_NS]
    # The third segment ends at the full hour, and so belongs to the next one.
    assert [hour.distance_m for hour in hours] == [1000.0, 500.0]
    assert [hour.plan_kwh for hour in hours] == pytest.approx([0.6, 0.2])


def test_what_comes_early_counts_now() -> None:
    """A vehicle ahead of its plan has driven by now."""
    parts = driven(make_plan(), ENERGY, 0.0, 4.0, BEGIN_NS + HOUR_NS - 1)
    assert {part.hour_ns for part in parts} == {BEGIN_NS}


@pytest.mark.slow
@given(st.lists(st.floats(0.0, 4.0), max_size=6))
def test_parts_of_a_way_are_the_whole(places: list[float]) -> None:
    """However often it is booked, a way counts once."""
    steps = pairwise(sorted({0.0, 4.0, *places}))
    plan = make_plan()
    parts = [p for begin, end in steps for p in driven(plan, ENERGY, begin, end, 2**62)]
    whole = list(driven(plan, ENERGY, 0.0, 4.0, 2**62))
    assert total(parts) == pytest.approx(total(whole), abs=1e-12)
    assert list(driven(plan, ENERGY, 3.0, 2.0, 2**62)) == []


def test_where_a_later_plan_begins() -> None:
    """On a segment of the leg that the vehicle has begun, at the leg's begin, or elsewhere."""
    plan = make_plan()
    assert replaced_at(plan, make_plan(1), 0.25, 0) == 1.25
    assert replaced_at(plan, make_plan(3, leg=1), 0.5, 1) == 3.5
    assert replaced_at(plan, make_plan(2, leg=1), 0.0, 1) == 2.0
    home = make_plan(2, leg=1).model_copy(update={"segments": ()})
    assert replaced_at(plan, home, 0.0, 1) == 2.0
    # It has not been at that stop yet, or is on another way.
    assert replaced_at(plan, make_plan(3, leg=1), 0.5, 0) is None
    elsewhere = make_plan(3, leg=1)
    other = elsewhere.segments[0].model_copy(update={"segment": "x"})
    elsewhere = elsewhere.model_copy(update={"segments": (other,)})
    assert replaced_at(plan, elsewhere, 0.5, 1) is None

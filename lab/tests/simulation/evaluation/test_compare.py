"""Figures of arms, and of arms against the baseline."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import pytest

from lab.tests.simulation.evaluation.fakes import GROUND, make_arm
from slipstream_lab.simulation.closed_loop.record import ArmResult, OrderService
from slipstream_lab.simulation.evaluation.arms import POLICIES
from slipstream_lab.simulation.evaluation.measures.compare import MIN_ORDERS, SeedSpread, compare
from slipstream_lab.simulation.evaluation.measures.curves import BIN_S, HOUR_S, day_course
from slipstream_lab.simulation.evaluation.measures.figures import Measures, measure
from slipstream_lab.simulation.fleet.safety import FleetSafety, OthersSafety


def arm(name: str, seed: int = 1, **changes: object) -> ArmResult:
    """A made-up arm by its name."""
    return make_arm(POLICIES[name], seed, **changes)  # type: ignore[arg-type]


def test_figures_are_sums_over_legs_services_and_cycles() -> None:
    """Distances, times and energies of all legs; what others had is taken over."""
    result = arm("C")
    found = measure(result)
    assert found.energy_kwh == pytest.approx(sum(leg.driven.total_kwh for leg in result.legs))
    assert sum(found.losses) == pytest.approx(found.alone.total_kwh)
    assert found.distance_km == pytest.approx(sum(leg.distance_m for leg in result.legs) / 1000)
    assert found.travel_h == pytest.approx(
        sum(leg.arrived_s - leg.ready_s for leg in result.legs) / 3600
    )
    assert found.platooned_share == pytest.approx(0.5)
    assert (found.open, found.judged, found.open_share) == (8 * 36, 360, 0.8)
    assert (found.orders, found.served, found.faults) == (24, 24, ())


def test_waits_and_driving_are_the_travel_time() -> None:
    """At the depot before a tour, at its stops before each later leg."""
    result = arm("C")
    legs = [
        replace(leg, leg=number % 3, departed_s=leg.ready_s + number)
        for number, leg in enumerate(result.legs[:5])
    ]
    found = measure(replace(result, legs=tuple(legs)))
    assert found.depot_waits_s == pytest.approx([0, 3])
    assert found.stop_waits_s == pytest.approx([1, 2, 4])
    assert found.driving_h + sum(found.waits_s) / 3600 == pytest.approx(found.travel_h)


def test_an_order_is_late_once_its_time_is_over() -> None:
    """Begun too late, or not begun though the day went on; not one that is still in time."""
    services = (
        OrderService("in-time", 25000.0, 24999.0),
        OrderService("late", 25000.0, 25001.0),
        OrderService("never", 25000.0, None),
        OrderService("not-yet", GROUND.end_s + 60, None),
    )
    found = measure(arm("B", services=services))
    assert (found.orders, found.served, found.late) == (4, 2, 2)
    assert found.planned_platooned_km == pytest.approx(3.6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gridlock_s": 30000.0}, "gridlock at 08:20"),
        ({"collisions": 3, "safety": FleetSafety(collisions=1)}, "1 collision of the fleet"),
        ({"teleports": 3, "safety": FleetSafety(teleports=2)}, "2 teleports of the fleet"),
        (
            {"emergency_stops": 1, "safety": FleetSafety(emergency_stops=1)},
            "1 emergency stop of the fleet",
        ),
        ({"served_again": 1}, "1 second service"),
        ({"services": ()}, "no order was served"),
    ],
)
def test_an_arm_that_broke_down_counts_nowhere(change: dict[str, object], words: str) -> None:
    """It says why, and neither it nor, if it is the baseline, its seed is compared."""
    broken, sound = measure(arm("C", **change)), measure(arm("B"))
    assert broken.faults == (words,)
    assert compare({"B": {1: sound}, "C": {1: broken}}).compared["C"] == {}
    base = measure(arm("B", **change))
    found = compare({"B": {1: base}, "C": {1: measure(arm("C"))}})
    assert (found.compared["C"], found.apart["C"]) == ({}, {1: "there is no sound B"})


def test_what_happens_to_others_counts_against_no_arm() -> None:
    """Only where SUMO teleports more than one in a hundred of them is the arm doubtful."""
    few = measure(arm("C", teleports=10, collisions=4, emergency_stops=2))
    assert (few.faults, few.others_safety) == ((), OthersSafety(4, 2, 10, trips=1000))
    assert not few.others_safety.is_doubtful
    many = measure(arm("C", teleports=12, safety=FleetSafety(teleports=1)))
    assert many.others_safety.is_doubtful
    assert many.faults == ("1 teleport of the fleet",)
    assert "C" in compare({"B": {1: measure(arm("B"))}, "C": {1: few}}).compared


def test_slower_driving_alone_is_no_saving_at_equal_time() -> None:
    """The paced baseline saves energy, none at equal time; a better arm saves at both."""
    names = ("B", "B-0.88", "B-0.94", "B-1.06", "C")
    found = compare({name: {1: measure(arm(name))} for name in names}).compared
    slow, better = found["B-0.88"][1], found["C"][1]
    assert slow.saving > 0.08
    assert slow.at_equal_time == pytest.approx(0.0, abs=1e-12)
    assert better.at_equal_time is not None
    assert 0 < better.at_equal_time < better.saving
    assert better.travel > 0


def test_the_parts_of_a_saving_add_up() -> None:
    """Distance, drag and acceleration are the whole; drag is what platoons had."""
    base, result = measure(arm("B")), measure(arm("C"))
    found = compare({"B": {1: base}, "C": {1: result}}).compared["C"][1]
    total, *parts = found.parts
    assert sum(parts) == pytest.approx(total)
    assert total == pytest.approx(base.energy_kwh - result.energy_kwh)
    assert found.shares.total_kwh == pytest.approx(found.saving)
    assert found.parts.drag_kwh == pytest.approx(result.alone.total_kwh - result.energy_kwh)
    assert found.at_equal_time is None
    assert found.unequal == "no pace of B was simulated beside it (--arms main has them)"


PACED = ("B", "B-0.88", "B-0.94", "B-1.06")


def test_arms_with_other_orders_do_not_compare() -> None:
    """Not as many, or as many others: there is no saving of any kind, and the reason is told."""
    whole = arm("B")
    half = replace(whole, legs=whole.legs[:12], services=whole.services[:12])
    last = whole.services[-1]
    other = replace(whole, services=(*whole.services[:-1], replace(last, order="another")))
    found = compare({"B": {1: measure(whole)}, "A": {1: measure(half)}, "C": {1: measure(other)}})
    assert (found.compared["A"], found.compared["C"]) == ({}, {})
    assert found.apart["A"] == {1: "not the same orders: B served 24, A 12, 12 of them the same"}
    assert found.apart["C"][1].endswith("B served 24, C 24, 23 of them the same")


@pytest.mark.parametrize("who", ["B", "C"])
def test_an_arm_whose_tours_have_not_ended_does_not_compare(who: str) -> None:
    """What its vehicles still had to drive is not in its energy."""
    runs = {name: {1: measure(arm(name))} for name in (*PACED, "C")}
    runs[who] = {1: measure(arm(who, unfinished=1))}
    found = compare(runs)
    assert (found.compared["C"], found.apart["C"]) == (
        {},
        {1: f"{who} ended with 1 tour under way"},
    )


def test_a_few_orders_are_too_little_to_compare() -> None:
    """Those of all seeds count together; below the least number there is no saving at all."""

    def runs(orders: int, seeds: Sequence[int]) -> dict[str, dict[int, Measures]]:
        return {
            name: {seed: measure(make_arm(POLICIES[name], seed, orders)) for seed in seeds}
            for name in (*PACED, "C")
        }

    one = compare(runs(1, [1]))
    assert one.compared["C"] == {}
    assert one.apart["C"] == {1: "too little to compare: 1 order, at least 20 count"}
    assert compare(runs(MIN_ORDERS - 1, [1])).compared["C"] == {}
    both = compare(runs(MIN_ORDERS // 2, [1, 2])).compared["C"]
    assert [both[seed].at_equal_time is None for seed in (1, 2)] == [False, False]


def test_nothing_is_compared_beyond_the_paces_that_were_simulated() -> None:
    """An arm slower than the slowest baseline has no saving at equal time, and says by how much."""
    slow = replace(POLICIES["C"], pace=0.7)
    runs = {name: {1: measure(arm(name))} for name in PACED}
    runs["C"] = {1: measure(make_arm(slow, 1))}
    found = compare(runs).compared["C"][1]
    assert found.at_equal_time is None
    assert re.fullmatch(
        r"\d+ s of travel an order, and B was simulated from \d+ to \d+ s", found.unequal
    )


def test_a_pace_with_other_orders_is_no_point_of_the_curve() -> None:
    """Only paces that did the same work say what the baseline would have needed."""
    runs = {name: {1: measure(arm(name))} for name in ("B", "C")}
    runs["B-0.88"] = {1: measure(arm("B-0.88", unfinished=2))}
    found = compare(runs).compared["C"][1]
    assert found.unequal == "no other pace of B served the same orders"


def test_spread_is_the_samples() -> None:
    """Mean and standard deviation over seeds; none of a single one."""
    assert SeedSpread.over([1.0, 2.0, 3.0]) == SeedSpread(2.0, 1.0, 3)
    assert SeedSpread.over([4.0]) == SeedSpread(4.0, None, 1)
    assert SeedSpread.over([]) is None


@pytest.mark.parametrize("bin_s", [BIN_S, HOUR_S])
def test_the_days_course_adds_up_to_the_day(bin_s: float) -> None:
    """Nothing is lost between bins, and a leg's energy lies where the leg does."""
    result = arm("C")
    found, whole = day_course(result, bin_s), measure(result)
    assert found.energy_kwh.sum() == pytest.approx(whole.energy_kwh)
    assert found.platooned_km.sum() == pytest.approx(whole.platooned_km)
    assert found.ends_s[-1] == GROUND.end_s
    assert len(found.ends_s) == (GROUND.end_s - GROUND.begin_s) / bin_s
    first = [leg for leg in result.legs if leg.arrived_s <= found.ends_s[0]]
    assert found.energy_kwh[0] >= sum(leg.driven.total_kwh for leg in first)


def test_a_part_of_an_hour_is_a_bin_of_its_own() -> None:
    """Hours are those of the clock, the last one as long as the simulation was."""
    result = arm("B", begin_s=6.25 * 3600, end_s=8.5 * 3600)
    assert day_course(result, HOUR_S).ends_s.tolist() == [7 * 3600, 8 * 3600, 8.5 * 3600]

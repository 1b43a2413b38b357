"""The gap law, against both vehicles' motions."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from slipstream.braking import BRAKING, Braking, BrakingClass, Road
from slipstream.spacing import (
    ADVISED_GAP_M,
    CLOSE_GAP_M,
    ENTRY_HEADWAY_S,
    LIMIT_RATIO,
    MAX_SLOWDOWN,
    MOST_VEHICLES,
    RESPONSE_S,
    SLOWING_SHARE,
    closing_m,
    driver_gap_m,
    front_limit_mps2,
    least_gap_m,
    longest_string,
    planned_gap_m,
    promised_mps2,
    reaction_s,
    wanted_gap_m,
)

speeds = st.floats(0.0, 60.0)
decelerations = st.floats(0.5, 11.0)
responses = st.floats(0.0, 2.0)
shares = st.floats(0.0, 0.5)
classes = st.sampled_from(tuple(BRAKING))
roads = st.sampled_from(("dry", "wet", "snow"))

PLAIN = Braking(
    guaranteed_mps2=4.0,
    greatest_mps2=8.0,
    dead_s=0.1,
    lag_s=0.1,
    tolerance=0.0,
    error=0.05,
    sensing_s=0.2,
    emergency_brake=True,
)
"""ρ = 0.5 s."""

brakes = st.builds(
    Braking,
    guaranteed_mps2=st.floats(0.5, 8.0),
    greatest_mps2=st.floats(8.0, 11.0),
    dead_s=st.floats(0.0, 0.5),
    lag_s=st.floats(0.0, 0.5),
    tolerance=shares,
    error=shares,
    sensing_s=st.floats(0.0, 0.5),
    emergency_brake=st.just(True),
)


def driven_m(
    front_mps: float, rear_mps: float, front_mps2: float, rear_mps2: float, response_s: float
) -> float:
    """Greatest closing of both motions, integrated: speeds are linear between the times."""
    end_s = max(front_mps / front_mps2, response_s + rear_mps / rear_mps2)
    kinks = [front_mps / front_mps2, response_s, response_s + rear_mps / rear_mps2]
    times = np.unique([*np.linspace(0.0, end_s + 1e-9, 4000), *kinks])
    front = np.maximum(0.0, front_mps - front_mps2 * times)
    rear = np.maximum(0.0, rear_mps - rear_mps2 * np.maximum(0.0, times - response_s))
    return greatest_m(times, rear - front)


def greatest_m(times: np.ndarray, nearing_mps: np.ndarray) -> float:
    """Greatest integral of a speed from the begin on."""
    steps = np.diff(times) * (nearing_mps[1:] + nearing_mps[:-1]) / 2
    return max(0.0, float(np.cumsum(steps).max()))


@pytest.mark.slow
@given(speeds, speeds, decelerations, decelerations, responses)
@example(20.0, 20.0, 8.0, 4.0, 0.5)  # b < a
@example(20.0, 20.1, 6.0, 6.0, 0.5)  # b = a
@example(30.0, 30.1, 2.0, 6.0, 0.7)  # b > a: the speeds meet
@example(2.0, 30.0, 4.0, 6.0, 0.7)  # b > a: the front stands before
@example(0.0, 20.0, 6.0, 7.0, 0.5)  # the front stands already
@example(20.0, 19.0, 1.1, 8.0, 1.0)  # the front is faster, and stays far enough
@example(20.0, 10.0, 1.0, 1.1, 1.0)  # likewise, so that the speeds never meet
@example(20.0, 18.0, 4.0, 5.0, 1.5)  # likewise at first, then nearer than it was
@example(3.0, 0.0, 6.0, 6.0, 0.5)
@example(0.0, 0.0, 6.0, 6.0, 0.5)
def test_closing_is_that_of_both_motions(
    front_mps: float, rear_mps: float, front_mps2: float, rear_mps2: float, response_s: float
) -> None:
    """In each of its branches, and never negative."""
    motion = front_mps, rear_mps, front_mps2, rear_mps2, response_s
    assert closing_m(*motion) == pytest.approx(driven_m(*motion), abs=2e-3)


@pytest.mark.parametrize(
    ("motion", "closing"),
    [
        ((20.0, 20.0, 8.0, 8.0, 0.5), 10.0),
        ((20.0, 20.0, 8.0, 4.0, 0.5), 35.0),
        ((20.0, 20.0, 2.0, 4.0, 0.5), 0.5),
        ((20.0, 21.0, 2.0, 4.0, 0.5), 1.75),
        ((1.0, 10.0, 1.0, 2.0, 0.5), 29.5),
        ((20.0, 19.0, 1.1, 8.0, 1.0), 0.0),
        ((20.0, 15.0, 8.0, 9.0, 0.9), 1.0),
    ],
)
def test_closing_by_hand(motion: tuple[float, float, float, float, float], closing: float) -> None:
    """Each line of the formula once."""
    assert closing_m(*motion) == pytest.approx(closing, abs=1e-9)


@pytest.mark.slow
@given(
    st.lists(speeds, min_size=2, max_size=2),
    st.lists(speeds, min_size=2, max_size=2),
    st.lists(decelerations, min_size=2, max_size=2),
    st.lists(decelerations, min_size=2, max_size=2),
    st.lists(responses, min_size=2, max_size=2),
)
def test_closing_is_monotone(
    fronts: list[float],
    rears: list[float],
    front_mps2: list[float],
    rear_mps2: list[float],
    response_s: list[float],
) -> None:
    """It grows with the rear one's speed, the front one's braking and the response, and falls with
    the front one's speed and the rear one's braking: each alone, so also all together.
    """
    best = [max(fronts), min(rears), min(front_mps2), max(rear_mps2), min(response_s)]
    worst = [min(fronts), max(rears), max(front_mps2), min(rear_mps2), max(response_s)]
    for number in range(5):
        worse = list(best)
        worse[number] = worst[number]
        assert closing_m(*best) <= closing_m(*worse) + 1e-9
        best = worse


@given(speeds, speeds, decelerations, decelerations, st.floats(0.0, 0.5), st.floats(0.01, 0.5))
@example(30.0, 30.0, 8.0, 6.0, 0.2, 0.2)
@example(30.0, 30.0, 2.0, 6.0, 0.2, 0.5)
def test_a_lag_is_covered_by_as_much_dead_time(
    front_mps: float,
    rear_mps: float,
    front_mps2: float,
    rear_mps2: float,
    dead_s: float,
    lag_s: float,
) -> None:
    """A first-order lag ends no nearer than full braking that much later, and b τ²/2 farther at
    most, so that the law gives next to nothing away.
    """
    end_s = max(front_mps / front_mps2, dead_s + 4 * lag_s + rear_mps / rear_mps2)
    times = np.linspace(0.0, end_s, 8000)
    since = np.maximum(0.0, times - dead_s)
    slower = rear_mps2 * (since - lag_s * (1 - np.exp(-since / lag_s)))
    front = np.maximum(0.0, front_mps - front_mps2 * times)
    lagged_m = greatest_m(times, np.maximum(0.0, rear_mps - slower) - front)
    closing = closing_m(front_mps, rear_mps, front_mps2, rear_mps2, dead_s + lag_s)
    assert closing - rear_mps2 * lag_s**2 / 2 - 1e-3 <= lagged_m <= closing + 1e-3


@given(st.floats(0.0, 5.0), decelerations, st.floats(0.2, 5.0), responses)
def test_the_branches_meet(
    faster_mps: float, front_mps2: float, harder_mps2: float, response_s: float
) -> None:
    """Where both speeds meet just as the front one stands, both lines say the same."""
    rear_mps2 = front_mps2 + harder_mps2
    meet_s = response_s + (faster_mps + front_mps2 * response_s) / harder_mps2
    at_mps = front_mps2 * meet_s
    assume(at_mps < 1e3)
    below, above = (
        closing_m(mps, mps + faster_mps, front_mps2, rear_mps2, response_s)
        for mps in (at_mps * (1 - 1e-9), at_mps * (1 + 1e-9) + 1e-12)
    )
    assert below == pytest.approx(above, rel=1e-6, abs=1e-6)


def test_the_response_of_a_follower() -> None:
    """Age of its sensing, one interval, and dead time and lag at their tolerance."""
    assert reaction_s(PLAIN) == pytest.approx(0.5)
    wide = replace(PLAIN, dead_s=0.3, lag_s=0.2, tolerance=0.2, sensing_s=0.05)
    assert wide.nominal_s == pytest.approx(0.5)
    assert wide.response_s == pytest.approx(0.6)
    assert reaction_s(wide) == pytest.approx(0.75)
    assert reaction_s(wide, 0.5) == pytest.approx(1.15)


def test_the_figures_that_pages_name() -> None:
    """docs/platooning.md and docs/safety.md: all who use them agree, and so do these pages."""
    assert (ADVISED_GAP_M, CLOSE_GAP_M, RESPONSE_S) == (2.0, 7.5, 0.1)
    assert (ENTRY_HEADWAY_S, MAX_SLOWDOWN, SLOWING_SHARE) == (3.0, 0.15, 0.9)


def test_the_least_gap_by_hand() -> None:
    """0.6 m, and what the gap shrinks by where the follower drives 0.1 m/s faster."""
    assert least_gap_m(20.0, 2.0, PLAIN) == pytest.approx(0.6 + 0.05 + 0.25 + 1.1**2 / 4)
    stops_m = 20.1 * 0.5 + 20.1**2 / 8 - 20.0**2 / 16
    assert least_gap_m(20.0, 8.0, PLAIN) == pytest.approx(0.6 + stops_m)
    assert least_gap_m(20.0, 2.0, PLAIN, 0.2) == pytest.approx(0.6 + 0.06 + 0.36 + 1.3**2 / 4)
    assert driver_gap_m(20.0) == pytest.approx(26.5)


@pytest.mark.slow
@given(
    speeds, speeds, decelerations, decelerations, brakes, st.floats(0.0, 0.3), st.floats(1.0, 2.0)
)
def test_the_least_gap_is_monotone(
    one_mps: float,
    other_mps: float,
    one_mps2: float,
    other_mps2: float,
    rear: Braking,
    more: float,
    times: float,
) -> None:
    """It grows with speed, braking ahead, and whatever makes the follower slower or weaker."""
    slow, fast = sorted((one_mps, other_mps))
    soft, hard = sorted((one_mps2, other_mps2))
    gap_m = least_gap_m(slow, soft, rear) - 1e-9
    assert gap_m <= least_gap_m(fast, soft, rear)
    assert gap_m <= least_gap_m(slow, hard, rear)
    assert gap_m <= least_gap_m(slow, soft, rear, 0.1 + more)
    for worse in (
        replace(rear, dead_s=rear.dead_s + more),
        replace(rear, lag_s=rear.lag_s + more),
        replace(rear, tolerance=rear.tolerance + more),
        replace(rear, sensing_s=rear.sensing_s + more),
        replace(rear, guaranteed_mps2=rear.guaranteed_mps2 / times),
    ):
        assert gap_m <= least_gap_m(slow, soft, worse)


@pytest.mark.slow
@given(st.floats(0.65, 30.0), brakes, speeds)
@example(20.0, PLAIN, 60.0)
@example(2.0, PLAIN, 30.0)
def test_a_limit_is_the_hardest_braking_that_a_gap_allows(
    gap_m: float, rear: Braking, speed_mps: float
) -> None:
    """At every speed; where it is so high that nobody stands before, gap and limit are inverse."""
    limit = front_limit_mps2(gap_m, rear)
    assume(limit > 0.002 * rear.guaranteed_mps2)
    assert 0 < limit <= rear.guaranteed_mps2 / 2
    assert least_gap_m(speed_mps, limit, rear) <= gap_m + 1e-6
    if limit < 0.499 * rear.guaranteed_mps2:
        assert least_gap_m(1e5, limit, rear) == pytest.approx(gap_m, abs=1e-4)


@pytest.mark.slow
@given(st.floats(0.0, 30.0), st.floats(0.0, 30.0), brakes, decelerations)
def test_limits_are_monotone(one_m: float, other_m: float, rear: Braking, own: float) -> None:
    """A larger gap allows harder braking; a promise of the follower's own bounds it."""
    near_m, far_m = sorted((one_m, other_m))
    near, far = front_limit_mps2(near_m, rear), front_limit_mps2(far_m, rear)
    assert near <= far
    assert front_limit_mps2(near_m, rear, own) == min(near, own / 1.15)


def test_a_gap_that_nothing_is_soft_enough_for_needs_next_to_no_braking() -> None:
    """A limit is told, and has to be above 0."""
    for gap_m in (0.0, 0.3, 0.6):
        assert front_limit_mps2(gap_m, PLAIN) == pytest.approx(0.004)


def test_nobody_promises_less_than_signals_and_turns_ask_for() -> None:
    """2 m/s², or half of what the vehicle can where that is less."""
    assert promised_mps2(3.0, PLAIN) == 3.0
    assert promised_mps2(1.0, PLAIN) == 2.0
    assert promised_mps2(1.0, replace(PLAIN, guaranteed_mps2=6.0)) == 2.0
    assert promised_mps2(0.1, replace(PLAIN, guaranteed_mps2=1.5)) == 0.75


def limits_mps2(braking: Braking, gap_m: float, vehicles: int) -> list[float]:
    """What the vehicles ahead of the last one promise, from the rear to the front."""
    found: list[float] = []
    for _ in range(vehicles):
        needed = front_limit_mps2(gap_m, braking, found[-1] if found else None)
        found.append(promised_mps2(needed, braking))
    return found


@given(classes, roads, st.floats(1.0, 5.0))
def test_limits_fall_from_the_rear_to_the_front(
    name: BrakingClass, road: Road, gap_m: float
) -> None:
    """By 1.15 a place, until the least promise is reached."""
    braking = BRAKING[name].on(road)
    least = min(2.0, braking.guaranteed_mps2 / 2)
    for behind, ahead in pairwise(limits_mps2(braking, gap_m, 6)):
        assert ahead == pytest.approx(max(least, behind / LIMIT_RATIO))


@pytest.mark.slow
@given(classes, roads, st.floats(1.5, 5.0), speeds)
def test_who_brakes_with_its_leader_keeps_its_own_promise(
    name: BrakingClass, road: Road, gap_m: float, speed_mps: float
) -> None:
    """A follower that has heard the leader begins within twice the tolerance and one interval of
    the vehicle ahead. Where both limits keep their ratio, its own one is then enough.
    """
    braking = BRAKING[name].on(road)
    late_s = 2 * braking.tolerance * braking.nominal_s + 0.1
    for behind, ahead in pairwise(limits_mps2(braking, gap_m, 4)):
        if behind / ahead > LIMIT_RATIO - 1e-9 and behind <= braking.guaranteed_mps2:
            needed_m = closing_m(speed_mps, speed_mps + 0.1, ahead, behind, late_s)
            assert needed_m <= gap_m - 0.6 + 1e-6


@given(classes, roads, st.floats(1.0, 8.0), st.floats(0.0, 36.0))
def test_in_the_longest_string_everybody_keeps_its_own_promise(
    name: BrakingClass, road: Road, gap_m: float, speed_mps: float
) -> None:
    """Whoever is between two others, at every speed; with one vehicle more somebody does not."""
    braking = BRAKING[name].on(road)
    longest = longest_string(gap_m, braking)
    assert 2 <= longest <= MOST_VEHICLES
    late_s = 2 * braking.tolerance * braking.nominal_s + RESPONSE_S

    def lacking_m(behind: float, ahead: float, mps: float) -> float:
        closing = closing_m(mps, mps + 0.1, ahead, behind, late_s)
        return 0.6 + closing - wanted_gap_m(mps, gap_m, ahead, braking)

    inside = [*pairwise(limits_mps2(braking, gap_m, longest - 1))]
    assert all(lacking_m(*pair, speed_mps) <= 1e-6 for pair in inside)
    if longest < MOST_VEHICLES:
        *_, beyond = pairwise(limits_mps2(braking, gap_m, longest))
        assert lacking_m(*beyond, 36.0) > 0


@given(classes, roads, st.floats(1.0, 8.0), st.floats(1.0, 8.0))
def test_a_larger_gap_allows_a_longer_string(
    name: BrakingClass, road: Road, one_m: float, other_m: float
) -> None:
    """And who promises nothing, as its vehicle has no emergency brake, has no bound by that."""
    braking, (near_m, far_m) = BRAKING[name].on(road), sorted((one_m, other_m))
    assert longest_string(near_m, braking) <= longest_string(far_m, braking)
    blind = replace(braking, emergency_brake=False)
    assert longest_string(near_m, blind) == MOST_VEHICLES


@pytest.mark.slow
@given(speeds, st.floats(0.0, 30.0), decelerations, brakes)
def test_a_wanted_gap_is_the_larger_one(
    speed_mps: float, advised_m: float, front_mps2: float, rear: Braking
) -> None:
    """Of the advised and the least one; with a longer interval too."""
    for interval_s in (0.1, 0.5):
        least_m = least_gap_m(speed_mps, front_mps2, rear, interval_s)
        wanted_m = wanted_gap_m(speed_mps, advised_m, front_mps2, rear, interval_s)
        assert wanted_m == max(advised_m, least_m)
    assert wanted_gap_m(speed_mps, advised_m, front_mps2, rear) == max(
        advised_m, least_gap_m(speed_mps, front_mps2, rear)
    )


@given(speeds, st.floats(0.1, 10.0), brakes)
def test_a_planned_gap_is_what_a_promise_allows(
    speed_mps: float, advised_m: float, braking: Braking
) -> None:
    """The advised one, unless the vehicle ahead may not promise so little. A vehicle without an
    emergency brake of its own keeps the unannounced gap, whatever is promised.
    """
    limit = promised_mps2(front_limit_mps2(advised_m, braking), braking)
    planned_m = planned_gap_m(speed_mps, advised_m, braking)
    assert planned_m == max(advised_m, least_gap_m(speed_mps, limit, braking))
    if front_limit_mps2(advised_m, braking) >= 2.0:
        assert planned_m == pytest.approx(advised_m, abs=1e-6)
    blind = replace(braking, emergency_brake=False)
    unannounced_m = least_gap_m(speed_mps, braking.greatest_mps2, braking)
    assert planned_gap_m(speed_mps, advised_m, blind) == max(advised_m, unannounced_m)


@pytest.mark.slow
@given(speeds, speeds, st.floats(0.1, 10.0), st.floats(0.1, 10.0), brakes)
def test_planned_gaps_are_monotone(
    one_mps: float, other_mps: float, one_m: float, other_m: float, braking: Braking
) -> None:
    """They grow with the speed, and are never below the advised gap."""
    slow, fast = sorted((one_mps, other_mps))
    near_m, far_m = sorted((one_m, other_m))
    assert planned_gap_m(slow, near_m, braking) <= planned_gap_m(fast, near_m, braking) + 1e-9
    assert planned_gap_m(slow, far_m, braking) >= far_m


@pytest.mark.parametrize("name", ["ideal", "brake_by_wire", "car", "van", "truck"])
@pytest.mark.parametrize("speed_mps", [13.9, 20.0, 22.2, 30.0])
def test_every_class_plans_the_advised_gap_on_dry_and_wet_roads(
    name: BrakingClass, speed_mps: float
) -> None:
    """2 m at all speeds of a road, where the unannounced gap of an ordinary car is 15 to 65 m."""
    for road in ("dry", "wet"):
        braking = BRAKING[name].on(road)
        planned_m = planned_gap_m(speed_mps, ADVISED_GAP_M, braking)
        assert math.isclose(planned_m, 2.0, abs_tol=1e-6)
        if name not in ("ideal", "brake_by_wire"):
            assert least_gap_m(speed_mps, braking.greatest_mps2, braking) > 10.0

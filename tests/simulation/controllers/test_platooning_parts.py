"""Closing, keeping and opening a gap without SUMO; common ways; when meeting pays."""

from collections.abc import Callable
from itertools import pairwise

import pytest

from simulation.controllers.platooning.gap_control import (
    Motion,
    close_gap_m,
    coasting_mps2,
    followed_gap_m,
    following_mps,
    has_left,
    leaving_distance_m,
    leaving_mps,
)
from simulation.controllers.platooning.rendezvous import (
    MARGIN_KWH,
    best_rendezvous,
    manoeuvre_kwh,
)
from simulation.controllers.platooning.shared_path import PathPosition, find_shared_path
from simulation.controllers.vehicle import VehicleState
from slipstream.energy import PAPER_CAR, drag_saving_kwh, steady_energy_kwh

LENGTHS = {"a": 1000.0, "b": 500.0, "c": 300.0, "d": 200.0, "e": 400.0}


def follow(
    leader: Callable[[float], float], gap_m: float, step_s: float, seconds: float, behind: int = 1
) -> tuple[list[list[float]], list[list[float]]]:
    """Speeds and gaps of followers, by step, behind a leader whose next speed nobody knows."""
    speeds = [leader(0.0)] * (behind + 1)
    gaps = [gap_m] * behind
    before = speeds[0]
    all_speeds, all_gaps = [speeds], [gaps]
    for number in range(1, round(seconds / step_s) + 1):
        now = speeds[0]
        coming = max(0.0, 2 * now - before)
        new = [leader(number * step_s)]
        for speed, ahead, gap in zip(speeds[1:], speeds, gaps, strict=False):
            coming = following_mps(Motion(speed, 30.0, gap), ahead, coming, 31.5, step_s)
            new.append(coming)
        gaps = [g + (f - r) * step_s for g, f, r in zip(gaps, new, new[1:], strict=False)]
        before, speeds = now, new
        all_speeds.append(speeds)
        all_gaps.append(gaps)
    return all_speeds, all_gaps


@pytest.mark.parametrize(("step_s", "gap_m"), [(0.1, 1.6), (0.5, 3.75)])
def test_gap_that_is_kept_is_the_advised_one_at_fine_steps(step_s: float, gap_m: float) -> None:
    """1 to 2 m at 0.1 s; at coarse steps as much more as unforeseen braking takes in a step."""
    assert followed_gap_m(step_s) == pytest.approx(gap_m, abs=0.02)
    assert close_gap_m(step_s) == 2 * followed_gap_m(step_s)
    speeds, gaps = follow(lambda now: 30.0, 40.0, step_s, 90.0)
    assert gaps[-1][0] == pytest.approx(gap_m, abs=0.1)
    assert speeds[-1][1] == pytest.approx(30.0, abs=0.05)


@pytest.mark.parametrize("step_s", [0.1, 0.5])
def test_catching_up_is_not_braked_away(step_s: float) -> None:
    """A follower that closes up slows down by coasting alone."""
    speeds, _ = follow(lambda now: 30.0, 40.0, step_s, 90.0)
    slowing = [(s[1] - t[1]) / step_s for s, t in pairwise(speeds)]
    assert 0.1 < max(slowing) <= coasting_mps2(31.5)


@pytest.mark.parametrize("step_s", [0.1, 0.5])
@pytest.mark.parametrize("braking", [1.0, 2.5, 4.5])
def test_a_platoon_of_five_brakes_without_touching(step_s: float, braking: float) -> None:
    """However hard the leader brakes, short of an emergency, nobody comes too near.

    Its unforeseen braking disturbs the first follower; behind that one it grows no more.
    """

    def leader(now: float) -> float:
        return max(8.0, 30.0 - braking * max(0.0, now - 5.0))

    speeds, gaps = follow(leader, followed_gap_m(step_s), step_s, 45.0, behind=4)
    for follower in range(4):
        assert min(g[follower] for g in gaps) > 0.4 * followed_gap_m(step_s)
        assert gaps[-1][follower] == pytest.approx(followed_gap_m(step_s), abs=0.3)
    slowest = [min(s[i] for s in speeds) for i in range(5)]
    assert slowest[1] > 8.0 - braking * step_s - 0.5
    assert min(slowest[2:]) > slowest[1] - 0.3


def test_a_gap_opens_gently_until_the_idm_can_take_over() -> None:
    """Parting does not brake, and takes about the way that is reckoned with."""
    for v0, step_s in ((30.0, 0.5), (13.9, 0.5), (30.0, 0.1)):
        speed, gap, shared_path = v0, followed_gap_m(step_s), 0.0
        assert not has_left(Motion(speed, v0, gap), v0)
        while not has_left(Motion(speed, v0, gap), v0):
            new = leaving_mps(Motion(speed, v0, gap), v0, v0, step_s)
            assert new >= speed - coasting_mps2(speed) * step_s - 1e-9
            gap += (v0 - new) * step_s
            speed, shared_path = new, shared_path + new * step_s
            assert shared_path < 1000.0
        assert shared_path == pytest.approx(leaving_distance_m(v0, followed_gap_m(step_s)), rel=0.2)
        assert speed > v0 - 4.0


def test_parting_keeps_away_from_a_vehicle_that_brakes() -> None:
    """Who is still near while the vehicle ahead stops, stops behind it."""
    ahead, speed, gap = 20.0, 20.0, followed_gap_m(0.5)
    for _ in range(60):
        coming = max(0.0, ahead - 2.5 * 0.5)
        speed = leaving_mps(Motion(speed, 20.0, gap), ahead, coming, 0.5)
        ahead = coming
        gap += (ahead - speed) * 0.5
        assert gap > 1.0
    assert speed == pytest.approx(0.0, abs=1e-6)


def place(path: str, number: int, front_m: float, *, crossing: bool = False) -> PathPosition:
    """Somewhere on a path of one-letter segments."""
    state = VehicleState(path[number], number, crossing, 0, front_m, 20.0, 0.0)
    return PathPosition(tuple(path), {s: i for i, s in enumerate(path)}, state)


def test_the_common_way_goes_from_the_rear_one_to_where_they_part() -> None:
    """Segments and distances, by hand; who is behind, elsewhere or too far has none."""
    rear, front = place("abcd", 0, 900.0), place("xbce", 1, 100.0)
    shared_path = find_shared_path(rear, front, LENGTHS, 2000.0)
    assert shared_path is not None
    assert shared_path.spacing_m == pytest.approx(200.0)
    assert shared_path.parts == (("a", 100.0), ("b", 600.0), ("c", 900.0))
    assert find_shared_path(front, rear, LENGTHS, 2000.0) is None
    assert find_shared_path(rear, front, LENGTHS, 150.0) is None
    assert find_shared_path(rear, place("xe", 1, 10.0), LENGTHS, 2000.0) is None
    inside = find_shared_path(
        place("abc", 0, 9.0, crossing=True), place("abc", 1, 5.0), LENGTHS, 2000.0
    )
    assert inside is not None
    assert inside.spacing_m == 0.0
    crossing = find_shared_path(rear, place("abc", 0, 8.0, crossing=True), LENGTHS, 2000.0)
    assert crossing is not None
    assert crossing.spacing_m == pytest.approx(108.0)


def test_open_gates_count_from_here_and_beyond() -> None:
    """A run ends at the first closed gate; later open segments count for a meeting alone."""
    shared_path = find_shared_path(
        place("abcd", 0, 900.0), place("abcd", 0, 950.0), LENGTHS, 2000.0
    )
    assert shared_path is not None
    assert shared_path.open_distance_m(lambda s: s != "c") == pytest.approx(600.0)
    assert shared_path.open_distance_m(lambda s: s != "a") == 0.0
    assert shared_path.open_beyond_m(0.0, lambda s: s != "b") == pytest.approx(600.0)
    assert shared_path.open_beyond_m(350.0, lambda s: s != "c") == pytest.approx(450.0)
    assert shared_path.open_beyond_m(5000.0, lambda s: True) == 0.0


def test_small_changes_of_speed_cost_nothing_to_first_order() -> None:
    """At the price of time at which v is best, a change by x costs 3 x² of the drag."""
    v, closing_s = 30.0, 60.0
    drag_kwh = PAPER_CAR.electrical_kwh(PAPER_CAR.drag_force_n(v) * v * closing_s)
    for a, b in ((0.05, 0.0), (0.0, 0.05), (0.02, 0.04)):
        price_kw = 2 * PAPER_CAR.electrical_kwh(PAPER_CAR.drag_force_n(v) * v) * 3600
        whole = 0.0
        for change in (a, -b):
            way_m = (1 + change) * v * closing_s
            whole += steady_energy_kwh(way_m, (1 + change) * v) - steady_energy_kwh(way_m, v)
            whole += price_kw * (closing_s - way_m / v) / 3600
        assert manoeuvre_kwh(a, b, v, closing_s) == pytest.approx(whole, rel=1e-9)
        assert whole == pytest.approx(3 * (a**2 + b**2) * drag_kwh, rel=0.05)


def test_a_meeting_is_worth_what_is_left_to_share() -> None:
    """It pays on a long common way and not on one that ends before the gap is closed."""

    def left(way_m: float) -> Callable[[float], float]:
        return lambda begin_m: max(0.0, way_m - begin_m)

    rendezvous = best_rendezvous(200.0, 30.0, left(8000.0), 0.25)
    assert rendezvous is not None
    assert rendezvous.way_m == pytest.approx((1 + rendezvous.speedup) * 30.0 * rendezvous.closing_s)
    relative = (rendezvous.speedup + rendezvous.slowdown) * 30.0
    assert rendezvous.closing_s * relative == pytest.approx(200.0)
    saved = drag_saving_kwh(8000.0 - rendezvous.way_m, 30.0, 0.25)
    cost = manoeuvre_kwh(rendezvous.speedup, rendezvous.slowdown, 30.0, rendezvous.closing_s)
    assert MARGIN_KWH < rendezvous.gain_kwh == pytest.approx(saved - cost)
    assert best_rendezvous(200.0, 30.0, left(1200.0), 0.25) is None
    assert best_rendezvous(1200.0, 30.0, left(90000.0), 0.25) is not None
    assert best_rendezvous(3000.0, 30.0, left(90000.0), 0.25) is None
    alone = best_rendezvous(200.0, 30.0, left(8000.0), 0.25, front_yields=False)
    assert alone is not None
    assert alone.slowdown == 0
    assert alone.gain_kwh < rendezvous.gain_kwh

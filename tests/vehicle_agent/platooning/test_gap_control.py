"""Closing, keeping and opening a gap; the safe gap that bounds all of it."""

import math
from itertools import pairwise

import pytest

from slipstream.energy.consumption import PAPER_CAR
from slipstream.energy.traction import coasting_mps2
from slipstream.spacing import MAX_BRAKING_MPS2, wanted_gap_m
from vehicle_agent.platooning.gap_control import (
    IDM,
    Own,
    following_mps,
    has_left,
    leaving_distance_m,
    leaving_mps,
    waiting_mps,
)
from vehicle_agent.platooning.safe_gap import STANDING_M, AheadMotion, safe_mps


def own(speed: float, interval_s: float, max_mps: float = 31.5) -> Own:
    """A follower that would drive 30 m/s alone."""
    return Own(speed, max_mps, 30.0, 1.5, interval_s, PAPER_CAR)


def steady(gap_m: float, speed: float, coming: float | None = None) -> AheadMotion:
    """A vehicle ahead whose next speed is known for all but the response time."""
    return AheadMotion(gap_m, speed, speed if coming is None else coming, 0.4, 0.5)


def test_the_wanted_gap_grows_with_the_speed_or_with_the_interval() -> None:
    """1.5 m and the larger of 0.1 s and what an emergency braking takes within an interval."""
    assert wanted_gap_m(30.0, 1.5, 0.1) == pytest.approx(4.5)
    assert wanted_gap_m(0.0, 1.5, 0.1) == pytest.approx(1.59)
    assert wanted_gap_m(13.9, 1.5, 0.5) == pytest.approx(3.75)
    assert wanted_gap_m(30.0, 1.5, 0.5) == pytest.approx(4.5)
    assert wanted_gap_m(30.0, 6.0, 0.1) == pytest.approx(9.0)


@pytest.mark.parametrize("interval_s", [0.1, 0.5])
def test_catching_up_is_not_braked_away(interval_s: float) -> None:
    """A follower that closes up slows down by coasting alone, and ends at the wanted gap."""
    speed, gap_m, speeds = 30.0, 40.0, [30.0]
    for _ in range(round(90 / interval_s)):
        speed = following_mps(own(speed, interval_s), steady(gap_m, 30.0))
        gap_m += (30.0 - speed) * interval_s
        speeds.append(speed)
    slowing = [(s - t) / interval_s for s, t in pairwise(speeds)]
    assert 0.1 < max(slowing) <= coasting_mps2(31.5, PAPER_CAR) + 1e-9
    assert gap_m == pytest.approx(wanted_gap_m(30.0, 1.5, interval_s), abs=0.1)


def test_a_gap_opens_gently_until_the_idm_can_take_over() -> None:
    """Parting does not brake, and takes about the way that is reckoned with."""
    for v0, interval_s in ((30.0, 0.5), (13.9, 0.5), (30.0, 0.1)):
        followed_m = wanted_gap_m(v0, 1.5, interval_s)
        speed, gap_m, way_m = v0, followed_m, 0.0
        vehicle = Own(speed, v0, v0, 1.5, interval_s, PAPER_CAR)
        assert not has_left(vehicle, steady(gap_m, v0))
        while not has_left(vehicle, steady(gap_m, v0)):
            new = leaving_mps(vehicle, steady(gap_m, v0))
            assert new >= speed - vehicle.coasting_mps2 * interval_s - 1e-9
            gap_m += (v0 - new) * interval_s
            speed, way_m = new, way_m + new * interval_s
            vehicle = Own(speed, v0, v0, 1.5, interval_s, PAPER_CAR)
            assert way_m < 1000.0
        reckoned_m = leaving_distance_m(v0, followed_m, PAPER_CAR)
        assert way_m == pytest.approx(reckoned_m, rel=0.2)
        assert speed > v0 - 4.0


def test_parting_keeps_away_from_a_vehicle_that_brakes() -> None:
    """Who is still near while the vehicle ahead stops, stops behind it."""
    ahead, speed, gap_m = 20.0, 20.0, wanted_gap_m(20.0, 1.5, 0.5)
    for _ in range(60):
        coming = max(0.0, ahead - 2.5 * 0.5)
        speed = leaving_mps(own(speed, 0.5), steady(gap_m, ahead, coming))
        ahead = coming
        gap_m += (ahead - speed) * 0.5
        assert gap_m > 1.0
    assert speed == pytest.approx(0.0, abs=1e-6)


def test_whoever_waits_slows_by_coasting_alone() -> None:
    """To the target and no farther; upwards at once."""
    set_mps = 30.0
    for _ in range(3):
        before, set_mps = set_mps, waiting_mps(set_mps, 27.0, own(30.0, 0.5))
        assert 0.0 < before - set_mps <= coasting_mps2(30.0, PAPER_CAR) * 0.5
    assert waiting_mps(27.01, 27.0, own(27.0, 0.5)) == 27.0
    assert waiting_mps(27.0, 28.5, own(27.0, 0.5)) == 28.5


def test_the_idm_is_the_published_one() -> None:
    """At its equilibrium gap it does not accelerate; at its desired speed on a free road neither.

    s_e(v) = (s₀ + v T) / √(1 − (v/v₀)⁴), Treiber, Hennecke, Helbing 2000, equation 5.
    """
    vehicle = own(20.0, 0.1)
    gap_m = (2.5 + 20.0 * 1.2) / math.sqrt(1 - (20.0 / 30.0) ** 4)
    assert IDM.acceleration_to_mps2(vehicle, gap_m, 20.0) == pytest.approx(0.0, abs=1e-12)
    free = IDM.acceleration_to_mps2(own(30.0, 0.1), 1e9, 30.0)
    assert free == pytest.approx(0.0, abs=1e-9)


def test_a_safe_gap_at_equal_speeds_is_that_of_the_response_time() -> None:
    """RSS: with equal braking, v ρ and what is left at a stand."""
    for interval_s, trusted_s, response_s in ((0.1, 0.0, 0.1), (0.5, 0.4, 0.1), (0.5, 0.0, 0.5)):
        gap_m = STANDING_M + 25.0 * response_s
        ahead = AheadMotion(gap_m, 25.0, 25.0, trusted_s, interval_s)
        assert safe_mps(25.0, ahead, interval_s) == pytest.approx(25.0)


def test_a_safe_command_behind_a_stopped_vehicle_stops_before_it() -> None:
    """From its way in the interval and its braking behind it, by hand."""
    command = safe_mps(10.0, AheadMotion(20.0, 0.0, 0.0), 0.1)
    way_m = (10.0 + command) / 2 * 0.1 + command**2 / (2 * MAX_BRAKING_MPS2)
    assert way_m == pytest.approx(20.0 - STANDING_M)
    assert safe_mps(10.0, AheadMotion(0.5, 0.0, 0.0), 0.1) == 0.0

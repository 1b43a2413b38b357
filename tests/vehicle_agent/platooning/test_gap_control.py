"""Closing, keeping and opening a gap."""

import math
from itertools import pairwise

import pytest

from slipstream.braking import BRAKING
from slipstream.energy.consumption import PAPER_CAR
from slipstream.energy.traction import coasting_mps2
from vehicle_agent.platooning.gap_control import (
    IDM,
    Own,
    following_mps2,
    has_left,
    leaving_distance_m,
    leaving_mps2,
    waiting_mps,
)
from vehicle_agent.platooning.needed_braking import AheadMotion, needed_mps2

IDEAL = BRAKING["ideal"].on("dry")
GAP_M = 4.0


def own(speed: float, interval_s: float, max_mps: float = 31.5) -> Own:
    """A follower that would drive 30 m/s alone."""
    return Own(speed, max_mps, 30.0, 1.5, interval_s, PAPER_CAR, IDEAL)


@pytest.mark.parametrize("interval_s", [0.1, 0.5])
def test_catching_up_is_not_braked_away(interval_s: float) -> None:
    """A follower that closes up slows down by coasting alone, and ends at the wanted gap."""
    speed, gap_m, speeds = 30.0, 40.0, [30.0]
    for _ in range(round(90 / interval_s)):
        follower = own(speed, interval_s)
        speed += following_mps2(follower, AheadMotion(gap_m, 30.0), GAP_M) * interval_s
        speed = min(speed, follower.max_mps)
        gap_m += (30.0 - speed) * interval_s
        speeds.append(speed)
    slowing = [(s - t) / interval_s for s, t in pairwise(speeds)]
    assert 0.1 < max(slowing) <= coasting_mps2(31.5, PAPER_CAR) + 1e-9
    assert gap_m == pytest.approx(GAP_M, abs=0.1)


def test_a_gap_opens_gently_until_the_idm_can_take_over() -> None:
    """Parting does not brake, and takes about the way that is reckoned with."""
    for v0, interval_s in ((30.0, 0.5), (13.9, 0.5), (30.0, 0.1)):
        speed, gap_m, way_m = v0, GAP_M, 0.0
        vehicle = Own(speed, v0, v0, 1.5, interval_s, PAPER_CAR, IDEAL)
        assert not has_left(vehicle, AheadMotion(gap_m, v0))
        while not has_left(vehicle, AheadMotion(gap_m, v0)):
            new = speed + leaving_mps2(vehicle, AheadMotion(gap_m, v0), GAP_M) * interval_s
            assert new >= speed - vehicle.coasting_mps2 * interval_s - 1e-9
            gap_m += (v0 - new) * interval_s
            speed, way_m = new, way_m + new * interval_s
            vehicle = Own(speed, v0, v0, 1.5, interval_s, PAPER_CAR, IDEAL)
            assert way_m < 1000.0
        assert way_m == pytest.approx(leaving_distance_m(v0, GAP_M, PAPER_CAR), rel=0.2)
        assert speed > v0 - 4.0


def test_a_gap_that_is_too_small_opens_gently() -> None:
    """However much is lacking: it is no emergency, as long as nobody brakes."""
    vehicle = own(20.0, 0.5)
    assert following_mps2(vehicle, AheadMotion(2.0, 20.0), 40.0) == pytest.approx(-0.5)
    opens = following_mps2(vehicle, AheadMotion(2.0, 20.3), 40.0)
    assert opens == pytest.approx(-vehicle.coasting_mps2)
    assert needed_mps2(AheadMotion(2.0, 20.0), 20.0, 20.0, 0.0) == 0.0


@pytest.mark.parametrize("gap_m", [2.2, 3.0, 6.0])
def test_a_withdrawn_promise_is_no_emergency_while_closing_up(gap_m: float) -> None:
    """The wanted gap is ten times as large from one interval to the next: the follower brakes
    comfortably, and comes no nearer than the close gap, but for a tenth of a metre.
    """
    speed, least_m, hardest = 20.4, gap_m, 0.0
    brakes = BRAKING["brake_by_wire"].on("dry")
    for _ in range(300):
        vehicle = Own(speed, 30.0, 30.0, 2.0, 0.1, PAPER_CAR, brakes)
        a = following_mps2(vehicle, AheadMotion(gap_m, 20.0, leader_mps=20.0), 18.0)
        hardest = min(hardest, a)
        speed += a * 0.1
        gap_m += (20.0 - speed) * 0.1
        least_m = min(least_m, gap_m)
    assert hardest > -1.5
    assert least_m > 1.9
    assert gap_m > 15.0


def test_a_follower_drives_what_its_leader_told() -> None:
    """At the wanted gap and equal speeds, that acceleration and nothing else."""
    ahead = AheadMotion(GAP_M, 20.0, slowing_mps2=1.7, feed_mps2=-1.7, leader_mps=20.0)
    assert following_mps2(own(20.0, 0.1), ahead, GAP_M) == pytest.approx(-1.7)


@pytest.mark.parametrize(
    ("speed", "front", "front_mps2", "gap_m"),
    [(20, 18, 3, 5), (20, 5, 4, 20), (15, 0, 0, 30), (20, 19, 2.5, 2.2)],
)
def test_needed_braking_ends_where_it_aims(
    speed: float, front: float, front_mps2: float, gap_m: float
) -> None:
    """Driven to the end after the response time, 0.6 m are left."""
    response_s, step_s = 0.4, 0.001
    braking = needed_mps2(
        AheadMotion(float(gap_m), float(front), float(front_mps2)), speed, speed, response_s
    )
    v, f, gap, least, now = float(speed), float(front), float(gap_m), math.inf, 0.0
    while v > 0 and now < 60:
        f = max(0.0, f - front_mps2 * step_s)
        v = max(0.0, v - (braking if now >= response_s else 0.0) * step_s)
        gap += (f - v) * step_s
        least, now = min(least, gap), now + step_s
    assert least == pytest.approx(0.6, abs=0.03)


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

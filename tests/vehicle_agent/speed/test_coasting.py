"""Rolling out: the closed forms against small time steps, and the best moment to begin."""

import numpy as np
import pytest

from slipstream.energy.consumption import PAPER_CAR, wheel_power_w
from vehicle_agent.speed.coasting import CoastingModel, braked_mps, braking_m

CAR = CoastingModel.of(PAPER_CAR)


def roll(speed_mps: float, to_mps: float, step_s: float = 1e-3) -> tuple[float, float]:
    """Seconds and metres of rolling down to a speed, in small steps."""
    seconds = metres = 0.0
    while speed_mps > to_mps:
        slower = speed_mps - CAR.resistance_n(speed_mps) / CAR.mass_kg * step_s
        metres += 0.5 * (speed_mps + slower) * step_s
        seconds += step_s
        speed_mps = slower
    return seconds, metres


def test_closed_forms_agree_with_small_steps() -> None:
    """Time, distance and speed of rolling are those of m dv/dt = −(r + k v²)."""
    seconds, metres = roll(13.4, 6.0)
    assert CAR.duration_s(13.4, 6.0) == pytest.approx(seconds, abs=2e-3)
    assert CAR.distance_m(13.4, 6.0) == pytest.approx(metres, abs=2e-2)
    assert CAR.after(13.4, seconds) == pytest.approx(6.0, abs=1e-3)
    assert CAR.speed_for(metres, seconds) == pytest.approx(13.4, abs=1e-3)


def test_rolling_needs_no_power_at_the_wheels() -> None:
    """Between two speeds of rolling the tractive power of eq. 1 is zero, to a step's error."""
    speeds = np.array([CAR.after(13.4, 0.1 * n) for n in range(200)])
    power = wheel_power_w(0.5 * (speeds[1:] + speeds[:-1]), np.diff(speeds) / 0.1)
    assert power.max() < 0.1


def test_rolling_ends_standing_still() -> None:
    """Who rolls for longer than it can stands, and does not go backwards."""
    assert CAR.after(3.0, 1000.0) == 0.0


@pytest.mark.parametrize("value_of_time_w", [4000.0, 9000.0, 20000.0])
@pytest.mark.parametrize("slow_mps", [0.0, 6.5])
def test_no_other_begin_of_rolling_is_cheaper(value_of_time_w: float, slow_mps: float) -> None:
    """Rolling down to 1/(1/v0 + R/(ηp)) costs least of all ways to roll, brake and stop there."""
    v0, braking, road_m = 13.4, 1.5, 700.0

    def cost_j(ends_mps: float) -> float:
        ends_mps = max(ends_mps, slow_mps)
        cruised_m = road_m - CAR.distance_m(v0, ends_mps) - braking_m(ends_mps, slow_mps, braking)
        seconds = cruised_m / v0 + CAR.duration_s(v0, ends_mps) + (ends_mps - slow_mps) / braking
        return cruised_m * CAR.resistance_n(v0) / CAR.efficiency + value_of_time_w * seconds

    best = CAR.braking_speed(v0, value_of_time_w)
    others = np.linspace(slow_mps + 0.01, v0, 500)
    assert cost_j(best) <= min(cost_j(float(speed)) for speed in others) + 1e-6
    if best > slow_mps:
        assert CAR.approach_m(v0, slow_mps, value_of_time_w, braking) == pytest.approx(
            CAR.distance_m(v0, best) + braking_m(best, slow_mps, braking)
        )


def test_who_rolls_goes_on_rolling() -> None:
    """At each later speed the road that rolling needs is longer than the road that is left."""
    left_m = CAR.approach_m(13.4, 0.0, 9000.0, 1.5)
    ends = CAR.braking_speed(13.4, 9000.0)
    for speed in np.linspace(13.3, ends + 0.01, 50):
        still_m = left_m - CAR.distance_m(13.4, float(speed))
        assert CAR.approach_m(float(speed), 0.0, 9000.0, 1.5) > still_m


def test_lost_time_is_against_braking_late() -> None:
    """What rolling adds: its time over the same road, less that of driving on and braking."""
    value_of_time_w, braking = 9000.0, 1.5
    ends = CAR.braking_speed(13.4, value_of_time_w)
    road_m = CAR.approach_m(13.4, 0.0, value_of_time_w, braking)
    rolled_s = CAR.duration_s(13.4, ends) + ends / braking
    braked_s = (road_m - braking_m(13.4, 0.0, braking)) / 13.4 + 13.4 / braking
    assert CAR.lost_s(13.4, 0.0, value_of_time_w, braking) == pytest.approx(rolled_s - braked_s)


def test_braking_speed_and_distance_are_inverse() -> None:
    """Braking from the speed that a distance allows takes that distance."""
    assert braking_m(braked_mps(40.0, 5.0, 1.5), 5.0, 1.5) == pytest.approx(40.0)

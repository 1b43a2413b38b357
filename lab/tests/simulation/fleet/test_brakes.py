"""What brakes make of a command, and sensors of the vehicle ahead."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from slipstream.braking import Road
from slipstream.messages import SensedVehicle, VehicleAdvice
from slipstream.vehicle_types import PRESETS
from slipstream_lab.simulation.fleet.brakes import Brakes, Reality
from slipstream_lab.simulation.fleet.safety import NOTHING, OthersSafety, SafetyWatch
from slipstream_lab.simulation.fleet.sensing import standing

CAR = PRESETS["paper_car"]


@pytest.mark.parametrize("step_s", [0.1, 0.5])
def test_a_command_comes_after_the_dead_time_and_the_lag(step_s: float) -> None:
    """In the end the speed that is lost later is the deceleration times both."""
    brakes, speed = Brakes(0.2, 0.2, 1.0, 8.0), 30.0
    for _ in range(round(4.0 / step_s)):
        speed = brakes.drive(speed, -3.0, step_s)
    assert brakes.acceleration_mps2 == pytest.approx(-3.0, abs=1e-3)
    assert speed == pytest.approx(30.0 - 3.0 * (4.0 - 0.4), abs=0.05)


def test_within_the_dead_time_nothing_changes() -> None:
    """A command that is taken back before has no effect either."""
    brakes = Brakes(0.2, 0.2, 1.0, 8.0)
    speeds = [brakes.drive(20.0, wanted, 0.1) for wanted in (-5.0, 0.0, 0.0)]
    assert speeds[:2] == [20.0, 20.0]
    assert speeds[2] < 20.0


def test_brakes_miss_a_command_and_have_an_end() -> None:
    """A share of what is commanded comes, full braking at most, and nobody drives backwards."""
    weak, hard = Brakes(0.0, 0.0, 0.95, 8.0), Brakes(0.0, 0.0, 1.0, 6.4)
    assert weak.drive(20.0, -2.0, 0.5) == pytest.approx(20.0 - 0.95)
    assert hard.drive(20.0, -9.0, 0.5) == pytest.approx(20.0 - 3.2)
    assert hard.drive(1.0, -9.0, 0.5) == 0.0


def test_a_vehicle_that_its_driver_drove_goes_on_from_there() -> None:
    """Its brakes begin with the acceleration that it has."""
    brakes = Brakes(0.2, 0.2, 1.0, 8.0)
    brakes.took(-2.0)
    assert brakes.drive(20.0, 0.0, 0.1) == pytest.approx(20.0 - 0.2)


@pytest.mark.parametrize("road", ["dry", "wet", "snow"])
def test_vehicles_are_drawn_within_what_is_declared(road: Road) -> None:
    """By seed and name, and nothing of an ideal one."""
    day = Reality.of_day(CAR, road, ideal=False, seed=1)
    declared = day.braking
    seen = set()
    for number in range(200):
        found = day.vehicle(f"v{number}")
        assert found is not None
        brakes = found.brakes
        assert abs(brakes.dead_s / declared.dead_s - 1) <= declared.tolerance
        assert abs(brakes.lag_s / declared.lag_s - 1) <= declared.tolerance
        assert abs(brakes.share - 1) <= declared.error
        assert declared.guaranteed_mps2 <= brakes.full_mps2 <= declared.greatest_mps2
        again = day.vehicle(f"v{number}")
        assert again is not None
        assert again.brakes.full_mps2 == brakes.full_mps2
        seen.add(brakes.full_mps2)
    assert len(seen) == 200
    assert Reality.of_day(CAR, road, ideal=True, seed=1).vehicle("v0") is None


def sensed(gap_m: float, own_mps: float, ahead_mps: float) -> Any:
    """Who is ahead of a vehicle on the road."""
    ahead = SensedVehicle(track="x", vehicle="front", gap_m=gap_m, speed_mps=ahead_mps)
    update = {"on_road": True, "speed_mps": own_mps, "ahead": ahead}
    return standing("rear", "a", 0).model_copy(update=update)


def test_the_vehicle_ahead_is_sensed_late_and_with_noise() -> None:
    """0.1 s ago it was faster and nearer; the noise has no bias."""
    exact = replace(
        Reality.of_day(CAR, "dry", ideal=False, seed=1), gap_noise_m=0.0, speed_noise_mps=0.0
    )
    found = exact.vehicle("rear")
    assert found is not None
    ahead = found.sensed(sensed(10.0, 20.0, 15.0), -3.0).ahead
    assert ahead is not None
    assert (ahead.gap_m, ahead.speed_mps) == (pytest.approx(10.5), pytest.approx(15.3))
    noisy = Reality.of_day(CAR, "dry", ideal=False, seed=1).vehicle("rear")
    assert noisy is not None
    many = [noisy.sensed(sensed(10.0, 20.0, 20.0), 0.0).ahead for _ in range(400)]
    gaps = [one.gap_m - 10.0 for one in many if one is not None]
    assert abs(sum(gaps) / 400) < 0.005
    assert 0.02 < (sum(gap * gap for gap in gaps) / 400) ** 0.5 < 0.04


def advised(mode: str, least_mps2: float | None = None) -> VehicleAdvice:
    """Advice to the rear vehicle, with a promise."""
    return VehicleAdvice.model_construct(mode=mode, partner="front", least_mps2=least_mps2)


def test_promises_that_are_broken_are_counted_once_each() -> None:
    """While it brakes harder than told, it is one time."""
    watch, speed = SafetyWatch(0.5), 20.0
    for braking in (1.0, 2.1, 4.0, 4.0, 1.0, 3.0):
        watch.advised(advised("speed", -2.0), sensed(9.0, speed, 20.0), held=False)
        speed -= 0.5 * braking
        watch.drove("rear", speed)
    assert watch.found.promises_broken == 2
    assert watch.found.most_over_mps2 == pytest.approx(2.0)
    watch.advised(advised("speed"), sensed(9.0, speed, 20.0), held=False)
    watch.drove("rear", speed - 4.0)
    assert watch.found.promises_broken == 2


def test_the_least_gap_is_that_of_followers() -> None:
    """Not of who opens the gap, or drives alone behind the same vehicle."""
    watch = SafetyWatch(0.5)
    for mode, gap_m in (("follow", 3.0), ("follow", 2.0), ("open_gap", 1.0), ("cruise", 0.5)):
        watch.advised(advised(mode), sensed(gap_m, 20.0, 20.0), held=mode == "cruise")
    assert (watch.found.least_gap_m, watch.found.held_back) == (2.0, 1)


def test_the_fleets_accidents_are_counted_apart() -> None:
    """Once each, for as long as they last; so are others'."""
    watch = SafetyWatch(0.5)
    for _ in range(3):
        watch.look([("car1", "car2"), ("car3", "cav/v1/0/0")], ["car4", "cav/v2/0/0"], ())
    watch.look((), (), ["cav/v1/0/0", "car3"], ["cav/v1/0/1", "car5"])
    assert watch.found == replace(NOTHING, collisions=1, emergency_stops=1, teleports=1)
    assert watch.others == OthersSafety(1, 1, 1, trips=1)
    assert watch.others.words == "1 collision, 1 emergency stop, 1 teleport"

"""Scenarios keep the statistics that the stability flag is judged against."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from slipstream_lab.simulation.streetdrive.clip import ClipFleet
from slipstream_lab.simulation.streetdrive.settings import SEGMENT_FAR_M, SEGMENT_NEAR_M
from slipstream_lab.simulation.streetdrive.traffic.paper_law import PaperLaw
from slipstream_lab.simulation.streetdrive.traffic.road import Road, VehicleTrack
from slipstream_lab.simulation.streetdrive.traffic.scenarios import TrafficDriver, simulate

FPS, SECONDS = 10.0, 40.0
ROAD = Road()


@lru_cache
def tracks_of(scenario: str, seed: int) -> tuple[list[VehicleTrack], ClipFleet]:
    """Trajectories of a scenario with the lengths of its rendered vehicles."""
    fleet = ClipFleet(seed)
    tracks = simulate(scenario, ROAD, seconds=SECONDS, fps=FPS, seed=seed, length_of=fleet.length_m)
    return tracks, fleet


def windows(tracks: list[VehicleTrack], direction: int) -> list[tuple[float, float, float, int]]:
    """Mean speed, CV of speed, variance of acceleration and vehicle count of each 10 s window."""
    found = []
    for first in range(0, round((SECONDS - 10) * FPS) + 1, round(FPS)):
        speeds, accelerations, count = [], [], 0
        for track in tracks:
            frames = track.first_frame + np.arange(len(track.x_m))
            chosen = (frames >= first) & (frames < first + 10 * FPS)
            chosen &= (track.x_m >= SEGMENT_NEAR_M) & (track.x_m <= SEGMENT_FAR_M)
            if track.lane.direction == direction and chosen.any():
                speeds.append(track.speed_mps[chosen])
                accelerations.append(track.acceleration_mps2[chosen])
                count += 1
        v, a = np.concatenate(speeds), np.concatenate(accelerations)
        found.append((float(v.mean()), float(v.std() / v.mean()), float(a.var()), count))
    return found


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("scenario", "direction"), [("stable", -1), ("stable", 1), ("mixed", -1)])
def test_stable_traffic_is_stable_in_every_window(scenario, direction, seed):
    """CV <= 0.06 and acceleration variance <= 0.1 m2/s4 at 16 to 17 m/s, 6 to 15 vehicles."""
    tracks, _ = tracks_of(scenario, seed)
    for mean, cv, variance, count in windows(tracks, direction):
        assert 15.9 <= mean <= 17.2
        assert cv <= 0.06
        assert variance <= 0.1
        assert 6 <= count <= 15


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    ("scenario", "direction"), [("turbulent", -1), ("turbulent", 1), ("mixed", 1)]
)
def test_turbulent_traffic_is_turbulent_in_every_window(scenario, direction, seed):
    """CV > 0.3 and acceleration variance > 1 m2/s4, far above the flag's thresholds."""
    tracks, _ = tracks_of(scenario, seed)
    for _, cv, variance, _ in windows(tracks, direction):
        assert cv > 0.3
        assert variance > 1.0


@pytest.mark.long
@pytest.mark.parametrize("scenario", ["stable", "turbulent", "paper"])
def test_no_two_vehicles_of_a_lane_overlap(scenario):
    """Bumper to bumper there is always more than half a metre."""
    tracks, fleet = tracks_of(scenario, 1)
    for lane in ROAD.lanes:
        mine = [t for t in tracks if t.lane == lane]
        for frame in range(0, round(SECONDS * FPS), 5):
            row = sorted(
                (float(t.x_m[frame - t.first_frame]), fleet.length_m(t.vehicle_id))
                for t in mine
                if 0 <= frame - t.first_frame < len(t.x_m)
            )
            for (x_a, l_a), (x_b, l_b) in pairwise(row):
                assert x_b - x_a - (l_a + l_b) / 2 > 0.5


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_paper_scenario_keeps_60_to_120_kmh(seed):
    """All speeds lie in 60 to 120 km/h and all vehicles accelerate."""
    tracks, _ = tracks_of("paper", seed)
    assert len(tracks) > 20
    for track in tracks:
        assert track.speed_mps.min() * 3.6 >= 60.0
        assert track.speed_mps.max() * 3.6 <= 120.0
        assert track.acceleration_mps2.min() > 0


def test_paper_law_is_the_papers_formula():
    """Position is Y_s + (Y_e - Y_s)(t/T)^1.5; velocity and acceleration are its derivatives."""
    law = PaperLaw(300.0, -20.0, 15.0)
    t = np.linspace(4.0, 15.0, 50)
    position, velocity, acceleration = law.at(t)
    assert position == pytest.approx(300.0 - 320.0 * (t / 15.0) ** 1.5)
    step = 1e-4
    before, after = law.at(t - step), law.at(t + step)
    assert velocity == pytest.approx((after[0] - before[0]) / (2 * step), rel=1e-6)
    assert acceleration == pytest.approx((after[1] - before[1]) / (2 * step), rel=1e-6)


def test_idm_rests_at_its_equilibrium():
    """At the equilibrium gap the acceleration is 0; closer it brakes and farther it speeds up."""
    driver = TrafficDriver(desired_speed_mps=20.0, time_gap_s=1.2)
    gap = (2.0 + 15.0 * 1.2) / np.sqrt(1 - (15 / 20) ** 4)
    assert driver.acceleration(15.0, gap, 15.0) == pytest.approx(0.0, abs=1e-9)
    assert driver.acceleration(15.0, gap * 0.7, 15.0) < 0 < driver.acceleration(15.0, 2 * gap, 15.0)


def test_unknown_scenario_is_refused():
    """A scenario that does not exist raises ValueError."""
    with pytest.raises(ValueError, match="unknown scenario"):
        simulate("rain", ROAD, seconds=1, fps=10, seed=0, length_of=lambda _: 4.0)

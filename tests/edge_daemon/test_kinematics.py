"""From sightings to the six features."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from edge_daemon.camera import Camera
from edge_daemon.kinematics import features_of
from edge_daemon.tracking import Sighting

FPS = 30
Position = Callable[[np.ndarray], np.ndarray]  # type: ignore[type-arg]


def observe(
    positions: list[tuple[Position, float]], sigma_m: float, seed: int = 1
) -> list[Sighting]:
    """Sightings over 10 s of vehicles given by distance driven over time and lane centre."""
    rng = np.random.default_rng(seed)
    times = np.arange(0, 10, 1 / FPS)
    sightings = []
    for track, (position, y) in enumerate(positions, start=1):
        for time_s, along in zip(times, position(times), strict=True):
            point = np.array([85.0 - along, y]) + rng.normal(0, sigma_m, 2)
            sightings.append(Sighting(track, time_s, point, np.eye(2) * sigma_m**2, 0))
    return sightings


def steady(start_s: float, speed: float) -> Position:
    """A vehicle at constant speed that is 85 m before the camera at a time."""
    return lambda t: speed * (t - start_s)


CALM = [(steady(s, 16.0 + 0.2 * (-1) ** i), 1.7) for i, s in enumerate(np.arange(-3, 8, 1.5))]


def test_calm_traffic_has_its_true_features_despite_noise(camera: Camera) -> None:
    """With 0.3 m of noise a raw second difference would show 10⁵ m²/s⁴; this shows about 0."""
    measured = features_of(observe(CALM, 0.3), camera.segments[0], 10.0)
    assert measured is not None
    f = measured.features
    assert measured.vehicles >= 6
    assert f.mean_speed_mps.value == pytest.approx(16.0, abs=0.1)
    assert f.speed_std_mps.value == pytest.approx(0.2, abs=0.15)
    assert f.mean_acceleration_mps2.value == pytest.approx(0.0, abs=0.15)
    assert f.acceleration_variance_m2ps4.value < 0.15
    # One vehicle each 1.5 s at 16 m/s is one in 24 m; all but the last second of the window.
    assert f.density_veh_per_m.value == pytest.approx(1 / 24, rel=0.15)
    assert f.mean_gap_m is not None
    assert f.mean_gap_m.value == pytest.approx(24 - 4.5, abs=1.0)


def test_stop_and_go_shows_its_acceleration_variance(camera: Camera) -> None:
    """v = 5 + 4 sin(2πt/8): σ_v² = 8 and σ²_a = (4·2π/8)²/2 = 4.9, measured within a quarter."""
    omega = 2 * np.pi / 8

    def wave(offset: float) -> Position:
        return lambda t: 5 * t + 25 + offset + 4 / omega * (1 - np.cos(omega * t))

    vehicles = [(wave(o), y) for o in (-22.0, -12.0, -2.0) for y in (1.7, 5.2)]
    measured = features_of(observe(vehicles, 0.2), camera.segments[0], 10.0)
    assert measured is not None
    assert measured.features.speed_std_mps.value == pytest.approx(np.sqrt(8), rel=0.2)
    assert measured.features.acceleration_variance_m2ps4.value == pytest.approx(4.93, rel=0.3)


def test_the_standard_error_of_the_mean_speed_is_honest(camera: Camera) -> None:
    """Over 40 noise draws the error is about what its standard error says."""
    ratios = []
    for seed in range(40):
        measured = features_of(observe(CALM, 0.5, seed), camera.segments[0], 10.0)
        noiseless = features_of(observe(CALM, 1e-4, seed), camera.segments[0], 10.0)
        assert measured is not None
        assert noiseless is not None
        got, true = measured.features.mean_speed_mps, noiseless.features.mean_speed_mps
        assert got.standard_error is not None
        ratios.append((got.value - true.value) / got.standard_error)
    assert 0.6 < float(np.std(ratios)) < 1.5


def test_an_empty_or_oncoming_road_has_no_features(camera: Camera) -> None:
    """Nothing is made up from nothing."""
    segment = camera.segments[0]
    assert features_of([], segment, 10.0) is None
    away: list[tuple[Position, float]] = [(lambda t: 70 - 15.0 * t, 1.7)]
    assert features_of(observe(away, 0.1), segment, 10.0) is None
    short: list[tuple[Position, float]] = [(lambda t: np.where(t < 0.5, 40 + 16 * t, 500.0), 1.7)]
    assert features_of(observe(short, 0.1), segment, 10.0) is None


def test_a_lone_vehicle_has_no_gap(camera: Camera) -> None:
    """A gap needs two vehicles in one lane."""
    measured = features_of(
        observe([(steady(1, 16), 1.7), (steady(1.2, 16), 5.2)], 0.1), camera.segments[0], 10.0
    )
    assert measured is not None
    assert measured.vehicles == 2
    assert measured.features.mean_gap_m is None

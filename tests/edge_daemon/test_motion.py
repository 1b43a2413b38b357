"""Smoothing one vehicle's positions, and what the variances are estimated from."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from edge_daemon.motion import MOST_BINS, Components, Fit, condense, estimate_components

Array = npt.NDArray[np.float64]
FPS = 30


def drive(
    acceleration: Array, sigma_m: float, rng: np.random.Generator, speed: float = 15.0
) -> tuple[Fit, Array, Array]:
    """A fit to noisy positions, with the true times and speeds behind it."""
    n = len(acceleration)
    times = np.arange(n) / FPS
    speeds = speed + np.cumsum(acceleration) / FPS
    along = np.cumsum(speeds) / FPS
    fit = Fit(condense(times, along + rng.normal(0, sigma_m, n), np.full(n, sigma_m**2)))
    return fit, times, speeds


def test_steady_motion_is_found_exactly() -> None:
    """Without noise or acceleration the posterior is the truth."""
    fit, _, _ = drive(np.zeros(90), 1e-3, np.random.default_rng(1))
    motion = fit.smooth(Components(0.1, 1.0))
    assert motion.speed_mps == pytest.approx(np.full(len(motion.speed_mps), 15.0), abs=0.02)
    assert np.abs(motion.acceleration_mps2).max() < 0.1


def test_speed_follows_an_acceleration_and_its_interval_holds_it() -> None:
    """Braking from 15 to 6 m/s: errors under 0.3 m/s, 95 % of them within 1.96 deviations."""
    rng = np.random.default_rng(2)
    inside, errors = [], []
    for _ in range(40):
        braking = -3.0 * np.sin(np.linspace(0, np.pi, 135)) ** 2
        fit, times, speeds = drive(braking, 0.2, rng)
        motion = fit.smooth(Components(2.0, 1.0))
        error = motion.speed_mps - np.interp(motion.time_s, times, speeds)
        errors.append(np.abs(error).mean())
        inside.append(np.abs(error) <= 1.96 * np.sqrt(np.diag(motion.speed_covariance)))
    assert np.mean(errors) < 0.3
    assert np.mean(np.concatenate(inside)) > 0.9


@pytest.mark.parametrize(("std", "sigma_m"), [(0.3, 0.1), (1.0, 0.2), (2.0, 0.3)])
def test_the_variance_of_acceleration_is_estimated_from_the_data(
    std: float, sigma_m: float
) -> None:
    """Twenty vehicles with sinusoidal accelerations of unlike phase: within a third."""
    rng = np.random.default_rng(3)
    fits = []
    for phase in rng.uniform(0, 2 * np.pi, 20):
        wave = np.sqrt(2) * std * np.sin(2 * np.pi * np.arange(150) / FPS / 8 + phase)
        fits.append(drive(wave, sigma_m, rng)[0])
    components = estimate_components(fits)
    motions = [fit.smooth(components) for fit in fits]
    second = np.mean([m.acceleration_mps2**2 + np.diag(m.acceleration_covariance) for m in motions])
    assert second == pytest.approx(std**2, rel=0.35)


def test_calm_traffic_is_not_made_rough_by_noise() -> None:
    """No acceleration at all under 0.3 m of noise: the estimate stays far under the threshold."""
    rng = np.random.default_rng(4)
    components = estimate_components([drive(np.zeros(105), 0.3, rng)[0] for _ in range(12)])
    assert components.acceleration_variance < 0.1


def test_noise_larger_than_stated_is_noticed() -> None:
    """Boxes three times as noisy as their variance says widen the intervals."""
    rng = np.random.default_rng(5)
    fits = []
    for _ in range(15):
        times = np.arange(120) / FPS
        along = 15.0 * times + rng.normal(0, 0.3, 120)
        fits.append(Fit(condense(times, along, np.full(120, 0.1**2))))
    assert estimate_components(fits).noise_scale > 2


def test_long_tracks_are_condensed_to_a_bounded_number_of_positions() -> None:
    """Standing traffic must not cost the cube of its frames."""
    times = np.arange(10 * FPS) / FPS
    positions = condense(times, np.zeros_like(times), np.full_like(times, 0.04))
    assert len(positions) <= MOST_BINS + 1
    assert (np.diff(positions.time_s) > 0).all()


def test_neighbouring_frames_do_not_count_as_independent() -> None:
    """At 120 frames a second four times the boxes do not give four times the certainty."""
    dense, sparse = np.arange(240) / 120, np.arange(60) / 30
    tight = condense(dense, np.zeros(240), np.full(240, 0.04)).variance_m2.mean()
    loose = condense(sparse, np.zeros(60), np.full(60, 0.04)).variance_m2.mean()
    assert tight > 0.6 * loose

"""Smoothing one vehicle's positions, and what the variances are estimated from."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from edge_daemon.features.smoother import (
    MAX_BINS,
    Motion,
    Positions,
    Smoother,
    VarianceComponents,
    bin_positions,
)

Array = npt.NDArray[np.float64]
FPS = 30


def alone(times: Array, along: Array, variance: Array) -> Positions:
    """One vehicle's positions, condensed."""
    (positions,) = bin_positions(np.zeros(len(times), dtype=np.intp), times, along, variance)
    return positions


def smooth(positions: list[Positions], components: VarianceComponents) -> list[Motion]:
    """The vehicles' motions, smoothed as one stack."""
    motion = Smoother(positions).smooth(components)
    return [motion.of(i, len(each)) for i, each in enumerate(positions)]


def drive(
    acceleration: Array, sigma_m: float, rng: np.random.Generator, speed: float = 15.0
) -> tuple[Positions, Array, Array]:
    """Noisy positions, with the true times and speeds behind them."""
    n = len(acceleration)
    times = np.arange(n) / FPS
    speeds = speed + np.cumsum(acceleration) / FPS
    along = np.cumsum(speeds) / FPS
    positions = alone(times, along + rng.normal(0, sigma_m, n), np.full(n, sigma_m**2))
    return positions, times, speeds


def test_steady_motion_is_found_exactly() -> None:
    """Without noise or acceleration the posterior is the truth."""
    positions, _, _ = drive(np.zeros(90), 1e-3, np.random.default_rng(1))
    (motion,) = smooth([positions], VarianceComponents(0.1, 1.0))
    assert motion.speed_mps == pytest.approx(np.full(len(motion.speed_mps), 15.0), abs=0.02)
    assert np.abs(motion.acceleration_mps2).max() < 0.1


def test_speed_follows_an_acceleration_and_its_interval_holds_it() -> None:
    """Braking from 15 to 6 m/s: errors under 0.3 m/s, 95 % of them within 1.96 deviations."""
    rng = np.random.default_rng(2)
    inside, errors = [], []
    for _ in range(40):
        braking = -3.0 * np.sin(np.linspace(0, np.pi, 135)) ** 2
        positions, times, speeds = drive(braking, 0.2, rng)
        (motion,) = smooth([positions], VarianceComponents(2.0, 1.0))
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
    positions = []
    for phase in rng.uniform(0, 2 * np.pi, 20):
        wave = np.sqrt(2) * std * np.sin(2 * np.pi * np.arange(150) / FPS / 8 + phase)
        positions.append(drive(wave, sigma_m, rng)[0])
    components = Smoother(positions).components().mean
    motions = smooth(positions, components)
    second = np.mean([m.acceleration_mps2**2 + np.diag(m.acceleration_covariance) for m in motions])
    assert second == pytest.approx(std**2, rel=0.35)


def test_calm_traffic_is_not_made_rough_by_noise() -> None:
    """No acceleration at all under 0.3 m of noise: the estimate stays far under the threshold."""
    rng = np.random.default_rng(4)
    calm = [drive(np.zeros(105), 0.3, rng)[0] for _ in range(12)]
    components = Smoother(calm).components().mean
    assert components.acceleration_variance < 0.1


def test_noise_larger_than_stated_is_noticed() -> None:
    """Boxes three times as noisy as their variance says widen the intervals."""
    rng = np.random.default_rng(5)
    positions = []
    for _ in range(15):
        times = np.arange(120) / FPS
        along = 15.0 * times + rng.normal(0, 0.3, 120)
        positions.append(alone(times, along, np.full(120, 0.1**2)))
    assert Smoother(positions).components().mean.noise_scale > 2


def test_long_tracks_are_condensed_to_a_bounded_number_of_positions() -> None:
    """Standing traffic must not cost the cube of its frames."""
    times = np.arange(10 * FPS) / FPS
    positions = alone(times, np.zeros_like(times), np.full_like(times, 0.04))
    assert len(positions) <= MAX_BINS + 1
    assert (np.diff(positions.time_s) > 0).all()


def test_neighbouring_frames_do_not_count_as_independent() -> None:
    """At 120 frames a second four times the boxes do not give four times the certainty."""
    dense, sparse = np.arange(240) / 120, np.arange(60) / 30
    tight = alone(dense, np.zeros(240), np.full(240, 0.04)).variance_m2.mean()
    loose = alone(sparse, np.zeros(60), np.full(60, 0.04)).variance_m2.mean()
    assert tight > 0.6 * loose


def test_vehicles_smoothed_together_move_as_they_would_alone() -> None:
    """Of 3 to 25 positions in one stack: what fills up the shorter rows tells nothing."""
    rng = np.random.default_rng(6)
    positions = [drive(rng.normal(0, 1, n), 0.2, rng)[0] for n in (18, 200, 60)]
    assert [len(each) for each in positions] == [3, 25, 10]
    together = Smoother(positions)
    apart = [Smoother([each]) for each in positions]
    posterior = together.components()
    means, covariances = together.accelerations(posterior)
    for i, (each, smoother) in enumerate(zip(positions, apart, strict=True)):
        n = len(each)
        alone_means, alone_covariances = smoother.accelerations(posterior)
        assert means[:, i, :n] == pytest.approx(alone_means[:, 0], abs=1e-6)
        assert covariances[:, i, :n, :n] == pytest.approx(alone_covariances[:, 0], abs=1e-6)
    components = VarianceComponents(0.7, 1.3)
    for motion, each in zip(smooth(positions, components), positions, strict=True):
        (wanted,) = smooth([each], components)
        for name in Motion.__dataclass_fields__:
            assert getattr(motion, name) == pytest.approx(getattr(wanted, name), abs=1e-7)


def test_accelerations_are_those_of_the_smoothed_motion() -> None:
    """By contrasts, and by the motion with all its parts: the same for each of the components."""
    rng = np.random.default_rng(8)
    positions = [drive(rng.normal(0, 1, n), 0.2, rng)[0] for n in (90, 40)]
    smoother = Smoother(positions)
    posterior = smoother.components()
    means, covariances = smoother.accelerations(posterior)
    columns = zip(
        *(posterior.acceleration_variance, posterior.noise_scale),
        posterior.mean_acceleration_mps2,
        strict=True,
    )
    for k, column in enumerate(columns):
        for i, motion in enumerate(smooth(positions, VarianceComponents(*map(float, column)))):
            n = len(positions[i])
            assert means[k, i, :n] == pytest.approx(motion.acceleration_mps2, abs=1e-6)
            wanted = motion.acceleration_covariance
            assert covariances[k, i, :n, :n] == pytest.approx(wanted, abs=1e-6)


def test_few_vehicles_on_a_short_way_do_not_tell_how_rough_traffic_is() -> None:
    """Three in view for 1.5 s with 0.6 m of noise leave most of the prior. Twenty for 5 s tell."""
    rng = np.random.default_rng(9)

    def spread(count: int, n: int) -> float:
        parts = [drive(np.zeros(n), 0.6, rng)[0] for _ in range(count)]
        posterior = Smoother(parts).components()
        calm = posterior.acceleration_variance <= 0.5
        return float(posterior.weight[calm].sum())

    assert spread(3, 45) < 0.8
    assert spread(20, 150) > 0.999


def test_vehicles_condensed_together_have_the_positions_they_would_have_alone() -> None:
    """Vehicle after vehicle, each with bins of its own."""
    rng = np.random.default_rng(7)
    parts = []
    for n, begin_s in ((40, 5.0), (300, 0.0), (9, 2.0)):
        times = begin_s + np.arange(n) / FPS
        parts.append((times, rng.normal(0, 1, n), rng.uniform(0.01, 0.1, n)))
    vehicle = np.repeat(np.arange(3), [len(times) for times, _, _ in parts])
    columns = (np.concatenate(column) for column in zip(*parts, strict=True))
    for got, part in zip(bin_positions(vehicle, *columns), parts, strict=True):
        wanted = alone(*part)
        for name in Positions.__dataclass_fields__:
            assert getattr(got, name) == pytest.approx(getattr(wanted, name))

"""From sightings to the six features."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from edge_daemon.camera import Camera
from edge_daemon.camera.segment import WatchedSegment
from edge_daemon.features.kinematics import SegmentKinematics, WindowFeatures
from edge_daemon.features.smoother import NOISE_CORRELATION_S, SLOW_SHARE
from edge_daemon.features.trajectories import NOMINAL_LENGTH_M, group_by_vehicle
from edge_daemon.tracking import Sightings

FPS = 30
Position = Callable[[np.ndarray], np.ndarray]  # type: ignore[type-arg]


def observe(positions: list[tuple[Position, float]], sigma_m: float, seed: int = 1) -> Sightings:
    """Sightings over 10 s of cars given by distance driven over time and lane centre.

    The camera stands at the origin and looks along +x; what is seen is the near end.
    """
    rng = np.random.default_rng(seed)
    times = np.arange(0, 10, 1 / FPS)
    n = len(times)
    parts = []
    for track, (position, y) in enumerate(positions, start=1):
        middle = np.column_stack([85.0 - position(times), np.full(n, y)])
        near_end = middle - [NOMINAL_LENGTH_M[0] / 2, 0.0]
        parts.append(
            Sightings(
                np.full(n, track),
                times,
                near_end + sigma_m * like_a_detectors(rng, n),
                np.tile(np.eye(2) * sigma_m**2, (n, 1, 1)),
                np.tile([1.0, 0.0], (n, 1)),
                np.zeros(n, dtype=np.int64),
                np.zeros((n, 4), dtype=np.float32),
            )
        )
    return Sightings.join(parts)


def like_a_detectors(rng: np.random.Generator, n: int) -> np.ndarray:  # type: ignore[type-arg]
    """Unit noise (n, 2) in the two parts that a detector's boxes show: one quick, one slow."""
    noise = np.zeros((n, 2))
    for share, correlation_s in ((1 - SLOW_SHARE, NOISE_CORRELATION_S), (SLOW_SHARE, 1.0)):
        keep = np.exp(-1 / FPS / correlation_s)
        part = rng.normal(0, 1, (n, 2))
        for i in range(1, n):
            part[i] = keep * part[i - 1] + np.sqrt(1 - keep**2) * part[i]
        noise += np.sqrt(share) * part
    return noise


def measure(sightings: Sightings, camera: Camera) -> WindowFeatures | None:
    """Features of the only segment over the whole window."""
    return SegmentKinematics(camera.segments[0], None).features(sightings, 0.0, 10.0)


def steady(start_s: float, speed: float) -> Position:
    """A vehicle at constant speed that is 85 m before the camera at a time."""
    return lambda t: speed * (t - start_s)


CALM = [(steady(s, 16.0 + 0.2 * (-1) ** i), 1.7) for i, s in enumerate(np.arange(-3, 8, 1.5))]


def test_calm_traffic_has_its_true_features_despite_noise(camera: Camera) -> None:
    """With 0.3 m of noise a raw second difference would show 10⁵ m²/s⁴; this shows about 0."""
    measured = measure(observe(CALM, 0.3), camera)
    assert measured is not None
    f = measured.features
    assert len(measured.vehicles) >= 6
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
    measured = measure(observe(vehicles, 0.2), camera)
    assert measured is not None
    assert measured.features.speed_std_mps.value == pytest.approx(np.sqrt(8), rel=0.2)
    assert measured.features.acceleration_variance_m2ps4.value == pytest.approx(4.93, rel=0.3)


@pytest.mark.attack
def test_a_vehicle_seen_before_the_segment_only_gives_no_features(camera: Camera) -> None:
    """Ten sightings far before the segment, two within: too few to measure, and no fault.

    An overloaded machine, which skips most frames, may have no other vehicle in the window.
    """
    times = np.append(np.arange(10) / 10, [1.8, 1.9])
    x = np.append(np.linspace(99.0, 97.0, 10), [77.0, 75.5])  # the outline begins at 80 m
    n = len(x)
    sightings = Sightings(
        np.ones(n, dtype=np.int64),
        times,
        np.column_stack([x, np.full(n, 1.7)]),
        np.tile(np.eye(2) * 0.04, (n, 1, 1)),
        np.tile([1.0, 0.0], (n, 1)),
        np.zeros(n, dtype=np.int64),
        np.zeros((n, 4), dtype=np.float32),
    )
    assert len(group_by_vehicle(sightings, camera.segments[0]).keys()) == 1
    assert measure(sightings, camera) is None


@pytest.mark.long
def test_the_standard_error_of_the_mean_speed_is_honest(camera: Camera) -> None:
    """Over 40 noise draws the truth lies within 1.96 standard errors, and these are not wide."""
    errors, deviations = [], []
    for seed in range(40):
        measured = measure(observe(CALM, 0.5, seed), camera)
        noiseless = measure(observe(CALM, 1e-4, seed), camera)
        assert measured is not None
        assert noiseless is not None
        got, true = measured.features.mean_speed_mps, noiseless.features.mean_speed_mps
        assert got.standard_error is not None
        errors.append(got.value - true.value)
        deviations.append(got.standard_error)
    assert np.mean(np.abs(errors) <= 1.96 * np.array(deviations)) >= 0.9
    assert np.mean(deviations) < 5 * np.std(errors)


def test_an_empty_or_oncoming_road_has_no_features(camera: Camera) -> None:
    """Nothing is made up from nothing."""
    away: list[tuple[Position, float]] = [(lambda t: 70 - 15.0 * t, 1.7)]
    assert measure(observe(away, 0.1), camera) is None
    assert measure(observe(away, 0.1).take(slice(0, 0)), camera) is None
    short: list[tuple[Position, float]] = [(lambda t: np.where(t < 0.5, 40 + 16 * t, 500.0), 1.7)]
    assert measure(observe(short, 0.1), camera) is None


def jumping(t: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """With the traffic, but that its track goes on with the vehicle behind."""
    return 15.0 * t - np.where(t < 2.5, 0.0, 40.0)


@pytest.mark.parametrize(
    ("position", "y", "wrong_way"),
    [
        (lambda t: 70 - 10.0 * t, 1.75, 1),
        (lambda t: 70 - 10.0 * t, 5.25, 1),
        # Half a metre from the outline, 0.2 m beyond it, and on the carriageway beside it.
        (lambda t: 70 - 10.0 * t, 0.5, 0),
        (lambda t: 70 - 10.0 * t, 7.2, 0),
        (lambda t: 70 - 10.0 * t, 8.75, 0),
        # It pushes back.
        (lambda t: 40 - 2.0 * t, 1.75, 0),
        (lambda t: np.maximum(60 - 10.0 * t, 50.0), 1.75, 0),
        (jumping, 1.75, 0),
        (steady(0.0, 15.0), 1.75, 0),
    ],
)
def test_who_drives_the_wrong_way(
    camera: Camera, position: Position, y: float, wrong_way: int
) -> None:
    """Who certainly does so on the segment counts, among traffic that runs along it."""
    kinematics = SegmentKinematics(camera.segments[0], None)
    kinematics.features(observe([*CALM, (position, y)], 0.3), 0.0, 10.0)
    assert kinematics.wrong_way == wrong_way


def test_a_lone_vehicle_has_no_gap(camera: Camera) -> None:
    """A gap needs two vehicles in one lane."""
    measured = measure(observe([(steady(1, 16), 1.7), (steady(1.2, 16), 5.2)], 0.1), camera)
    assert measured is not None
    assert len(measured.vehicles) == 2
    assert measured.features.mean_gap_m is None


def test_what_was_seen_before_the_window_counts_for_nothing_in_it(camera: Camera) -> None:
    """It only helps to smooth: presence is counted from the window's beginning."""
    whole = measure(observe(CALM, 0.1), camera)
    later = SegmentKinematics(camera.segments[0], None).features(observe(CALM, 0.1), 5.0, 5.0)
    assert whole is not None
    assert later is not None
    present = sum(v.weight_s.sum() for v in later.vehicles)
    assert present < sum(v.weight_s.sum() for v in whole.vehicles) - 5.0
    assert min(v.motion.time_s[v.weight_s > 0].min() for v in later.vehicles) > 4.8


def test_a_vehicle_in_parts_of_the_segment_counts_for_its_time_there(camera: Camera) -> None:
    """60 m at 15 m/s are 4 s, of a vehicle that is followed from before to after."""
    measured = measure(observe([(steady(0.5, 15.0), 1.7)], 0.05), camera)
    assert measured is not None
    assert float(measured.vehicles[0].weight_s.sum()) == pytest.approx(4.0, abs=0.05)


def test_speeds_are_those_along_a_road_that_bends(camera: Camera) -> None:
    """On a curve of 120 m radius the way along the segment's direction is up to 6 % short."""
    radius, speed = 120.0, 15.0
    parts = []
    for track, start_s in enumerate(np.arange(-2.0, 7.0, 1.2), start=1):
        angle = speed * (np.arange(0, 10, 1 / FPS) - start_s) / radius - 0.35
        parts.append(
            replace(
                observe([(steady(0.0, 1.0), 1.7)], 0.05, track),
                track=np.full(len(angle), track),
                point_m=np.column_stack(
                    [50.0 - radius * np.sin(angle), 3.5 + 3.0 - radius * (1 - np.cos(angle))]
                ),
            )
        )
    measured = measure(Sightings.join(parts), wide(camera))
    assert measured is not None
    assert measured.features.mean_speed_mps.value == pytest.approx(speed, abs=0.12)
    assert measured.features.speed_std_mps.value < 0.3


def wide(camera: Camera) -> Camera:
    """The same camera over a segment wide enough for the curve."""
    outline = np.array([[20.0, -30.0], [80.0, -30.0], [80.0, 30.0], [20.0, 30.0]])
    segment = WatchedSegment("bend", outline, np.array([-1.0, 0.0]), 60.0, 1, 60.0)
    bent = copy(camera)
    bent.segments = (segment,)
    return bent


def test_what_is_kept_between_windows_changes_nothing(camera: Camera) -> None:
    """Measured window after window, the last one is what it would be on its own."""
    sightings = observe(CALM, 0.2)
    kept = SegmentKinematics(camera.segments[0], None)
    for now in (6.0, 7.0, 8.0, 9.0):
        kept.features(sightings.take(sightings.time_s <= now), 0.0, now)
    last, alone = kept.features(sightings, 0.0, 10.0), measure(sightings, camera)
    assert last is not None
    assert alone is not None
    for name in ("mean_speed_mps", "speed_std_mps", "acceleration_variance_m2ps4"):
        got, wanted = getattr(last.features, name), getattr(alone.features, name)
        assert got.value == pytest.approx(wanted.value, rel=1e-3, abs=1e-4)

"""Following vehicles in metres."""

from __future__ import annotations

import numpy as np
import pytest

from edge_daemon.tracking import Sightings, Tracker
from edge_daemon.tracking.timing import FrameTiming

from ..conftest import seen_at

FPS = 30


def lanes(time_s: float) -> np.ndarray:  # type: ignore[type-arg]
    """Three vehicles, two side by side at unlike speeds."""
    return np.array(
        [[80 - 16.0 * time_s, 1.7], [75 - 14.0 * time_s, 5.2], [60 - 16.0 * time_s, 1.7]]
    )


def drive(
    tracker: Tracker, seconds: float, *, hidden: tuple[float, float] | None = None, seed: int = 1
) -> Sightings:
    """Feed noisy detections in; one vehicle is hidden for a while."""
    rng = np.random.default_rng(seed)
    parts = []
    for frame in range(int(seconds * FPS)):
        now = frame / FPS
        points = lanes(now) + rng.normal(0, 0.15, (3, 2))
        if hidden and hidden[0] <= now < hidden[1]:
            points = points[1:]
        parts.append(tracker.update(now, seen_at(points, 0.15)))
    return Sightings.join(parts)


def test_each_vehicle_keeps_one_identity_and_its_speed() -> None:
    """No switches, no fragments; filtered speeds are right to a few tenths."""
    tracker = Tracker()
    sightings = drive(tracker, 3.0)
    assert len(set(sightings.track)) == 3
    assert len(sightings) == 3 * 90
    by_speed = sorted(t.speed_mps for t in tracker.tracks)
    assert by_speed == pytest.approx([14.0, 16.0, 16.0], abs=0.5)
    for track, time_s, point in zip(
        sightings.track, sightings.time_s, sightings.point_m, strict=True
    ):
        nearest = np.abs(lanes(time_s) - point).sum(axis=1).argmin()
        assert (track, nearest) in {(1, 0), (2, 1), (3, 2)}


def test_a_vehicle_hidden_for_a_second_is_the_same_afterwards() -> None:
    """Tracks coast through an occlusion."""
    tracker = Tracker()
    sightings = drive(tracker, 3.5, hidden=(1.5, 2.5))
    assert len(set(sightings.track)) == 3


def test_a_vehicle_gone_for_longer_is_dropped() -> None:
    """Its track ends, and a later one is new."""
    tracker = Tracker()
    sightings = drive(tracker, 4.0, hidden=(1.0, 2.6))
    assert len(set(sightings.track)) == 4


def test_a_single_false_detection_makes_no_vehicle() -> None:
    """A track counts only after several detections."""
    tracker = Tracker()
    assert not len(tracker.update(0.0, seen_at(np.array([[50.0, 2.0]]), 0.2)))
    for frame in range(1, 30):
        assert not len(tracker.update(frame / FPS, seen_at(np.empty((0, 2)), 0.2)))
    assert tracker.tracks == ()


def test_unsure_detections_keep_tracks_but_start_none() -> None:
    """Low scores are used for what is already followed."""
    tracker = Tracker()
    for frame in range(30):
        point = np.array([[60 - 15.0 * frame / FPS, 2.0]])
        score = 0.9 if frame < 5 else 0.15
        sightings = tracker.update(frame / FPS, seen_at(point, 0.2, score))
    assert sightings.track.tolist() == [1]
    fresh = Tracker()
    for frame in range(30):
        assert not len(fresh.update(frame / FPS, seen_at(np.array([[50.0, 2.0]]), 0.2, 0.15)))


def test_reset_forgets_but_never_gives_an_identity_twice() -> None:
    """After a cut the same place holds another vehicle."""
    tracker = Tracker()
    before = set(drive(tracker, 1.0).track)
    tracker.reset()
    after = set(drive(tracker, 1.0).track)
    assert before
    assert after
    assert not before & after


def test_the_same_detections_give_the_same_tracks() -> None:
    """Tracking is deterministic."""
    one = drive(Tracker(), 1.0)
    two = drive(Tracker(), 1.0)
    assert one.track.tolist() == two.track.tolist()
    assert np.array_equal(one.point_m, two.point_m)


def test_a_second_box_on_a_vehicle_makes_no_second_vehicle() -> None:
    """Two vehicles cannot be in one place: neither born there nor kept there."""
    tracker = Tracker()
    parts = []
    for frame in range(60):
        x = 70 - 12.0 * frame / FPS
        points = [[x, 2.0]] + ([[x + 1.2, 2.3]] if 20 <= frame < 50 else [])
        parts.append(tracker.update(frame / FPS, seen_at(np.array(points), 0.1)))
    assert set(Sightings.join(parts).track) == {1}
    assert len(tracker.tracks) == 1


def test_two_tracks_that_end_up_on_one_vehicle_become_one() -> None:
    """A false track that drifts onto a vehicle is dropped; the older identity stays."""
    tracker = Tracker()
    for frame in range(90):
        now = frame / FPS
        points = [[50.0 - 5.0 * now, 2.0]]
        if frame >= 10:
            points.append([50.0 - 5.0 * now + max(0.0, 6.0 - 4.0 * (now - 10 / FPS)), 2.0])
        tracker.update(now, seen_at(np.array(points), 0.1))
    assert [track.id for track in tracker.tracks] == [1]


def jittered(std_s: float, seed: int) -> tuple[Tracker, Sightings]:
    """Five vehicles at 20 to 28 m/s for 5 s, the frames' times wrong by a normal error."""
    tracker = Tracker()
    rng = np.random.default_rng(seed)
    speeds = np.linspace(20, 28, 5)
    parts = []
    said_s = -1.0
    for number in range(150):
        true_s = number / FPS
        said_s = max(true_s + rng.normal(0, std_s), said_s + 1e-3)
        points = np.column_stack([200 - speeds * true_s, 4.0 * np.arange(5)])
        parts.append(tracker.update(said_s, seen_at(points + rng.normal(0, 0.1, (5, 2)), 0.1)))
    return tracker, Sightings.join(parts)


@pytest.mark.parametrize(("std_s", "seed"), [(0.010, 0), (0.020, 1), (0.033, 2)])
def test_frames_with_wrong_times_lose_no_vehicle(std_s: float, seed: int) -> None:
    """At 28 m/s 33 ms are 0.9 m, nine times what boxes err; speeds stay right to 1 m/s."""
    tracker, sightings = jittered(std_s, seed)
    assert len(set(sightings.track[sightings.time_s > 1.0])) == 5
    assert len(sightings) >= 0.99 * 5 * 150
    speeds = sorted(track.speed_mps for track in tracker.tracks)
    assert speeds == pytest.approx([20, 22, 24, 26, 28], abs=1.0)


@pytest.mark.slow
def test_the_error_of_times_is_measured_and_nothing_else_passes_for_it() -> None:
    """Neither noise of boxes nor vehicles that brake together do."""
    timing = FrameTiming()
    rng = np.random.default_rng(5)
    velocity = np.tile([-25.0, 0.0], (4, 1))
    for _ in range(300):
        late = velocity * rng.normal(0, 0.02)
        found = late + rng.normal(0, 0.1, (4, 2))
        timing.learn(1 / FPS, found, velocity, np.tile(np.eye(2) * 0.1**2, (4, 1, 1)))
    assert timing.variance_s2 == pytest.approx(0.02**2, rel=0.3)
    assert jittered(0.0, 1)[0].timing.variance_s2 == 0
    tracker = Tracker()
    for number in range(120):
        now = number / FPS
        along = 200 - 25 * now + 3.0 * max(0.0, now - 1.0) ** 2 / 2
        points = np.column_stack([along + 15 * np.arange(4), np.zeros(4)])
        tracker.update(now, seen_at(points + rng.normal(0, 0.1, points.shape), 0.1))
    assert tracker.timing.variance_s2 == 0

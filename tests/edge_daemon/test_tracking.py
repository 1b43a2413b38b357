"""Following vehicles in metres."""

from __future__ import annotations

import numpy as np
import pytest

from edge_daemon.tracking import Sighting, Tracker, TrackerSettings

from .conftest import seen_at

FPS = 30


def lanes(time_s: float) -> np.ndarray:  # type: ignore[type-arg]
    """Three vehicles, two side by side at unlike speeds."""
    return np.array(
        [[80 - 16.0 * time_s, 1.7], [75 - 14.0 * time_s, 5.2], [60 - 16.0 * time_s, 1.7]]
    )


def drive(
    tracker: Tracker, seconds: float, *, hidden: tuple[float, float] | None = None, seed: int = 1
) -> list[Sighting]:
    """Feed noisy detections in; one vehicle is hidden for a while."""
    rng = np.random.default_rng(seed)
    sightings = []
    for frame in range(int(seconds * FPS)):
        now = frame / FPS
        points = lanes(now) + rng.normal(0, 0.15, (3, 2))
        if hidden and hidden[0] <= now < hidden[1]:
            points = points[1:]
        sightings += tracker.update(now, seen_at(points, 0.15))
    return sightings


def test_each_vehicle_keeps_one_identity_and_its_speed() -> None:
    """No switches, no fragments; filtered speeds are right to a few tenths."""
    tracker = Tracker(TrackerSettings())
    sightings = drive(tracker, 3.0)
    assert len({s.track for s in sightings}) == 3
    assert len(sightings) == 3 * 90
    by_speed = sorted(t.speed_mps for t in tracker.tracks)
    assert by_speed == pytest.approx([14.0, 16.0, 16.0], abs=0.5)
    for sighting in sightings:
        nearest = np.abs(lanes(sighting.time_s) - sighting.point_m).sum(axis=1).argmin()
        assert (sighting.track, nearest) in {(1, 0), (2, 1), (3, 2)}


def test_a_vehicle_hidden_for_a_second_is_the_same_afterwards() -> None:
    """Tracks coast through an occlusion."""
    tracker = Tracker(TrackerSettings())
    sightings = drive(tracker, 3.5, hidden=(1.5, 2.4))
    assert len({s.track for s in sightings}) == 3


def test_a_vehicle_gone_for_longer_is_dropped() -> None:
    """Its track ends, and a later one is new."""
    tracker = Tracker(TrackerSettings())
    sightings = drive(tracker, 4.0, hidden=(1.0, 2.6))
    assert len({s.track for s in sightings}) == 4


def test_a_single_false_detection_makes_no_vehicle() -> None:
    """A track counts only after several detections."""
    tracker = Tracker(TrackerSettings())
    assert tracker.update(0.0, seen_at(np.array([[50.0, 2.0]]), 0.2)) == []
    for frame in range(1, 30):
        assert tracker.update(frame / FPS, seen_at(np.empty((0, 2)), 0.2)) == []
    assert tracker.tracks == ()


def test_unsure_detections_keep_tracks_but_start_none() -> None:
    """Low scores are used for what is already followed."""
    tracker = Tracker(TrackerSettings())
    for frame in range(30):
        point = np.array([[60 - 15.0 * frame / FPS, 2.0]])
        score = 0.9 if frame < 5 else 0.15
        sightings = tracker.update(frame / FPS, seen_at(point, 0.2, score))
    assert [s.track for s in sightings] == [1]
    fresh = Tracker(TrackerSettings())
    for frame in range(30):
        assert fresh.update(frame / FPS, seen_at(np.array([[50.0, 2.0]]), 0.2, 0.15)) == []


def test_reset_forgets_but_never_gives_an_identity_twice() -> None:
    """After a cut the same place holds another vehicle."""
    tracker = Tracker(TrackerSettings())
    before = {s.track for s in drive(tracker, 1.0)}
    tracker.reset()
    after = {s.track for s in drive(tracker, 1.0)}
    assert before
    assert after
    assert not before & after


def test_the_same_detections_give_the_same_tracks() -> None:
    """Tracking is deterministic."""
    one = drive(Tracker(TrackerSettings()), 1.0)
    two = drive(Tracker(TrackerSettings()), 1.0)
    assert [(s.track, s.time_s, *s.point_m) for s in one] == [
        (s.track, s.time_s, *s.point_m) for s in two
    ]

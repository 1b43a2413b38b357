"""Vehicles that stand: when the event begins, what does not end it, and what does."""

from __future__ import annotations

import numpy as np
import pytest

from edge_daemon.camera import WatchedSegment
from edge_daemon.features.stopped import StoppedVehicleJudge
from edge_daemon.tracking import Sightings

FPS = 10.0
SEGMENT = WatchedSegment(
    "s",
    np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 7.0), (0.0, 7.0)]),
    np.array([1.0, 0.0]),
    100.0,
    2,
    3.5,
)


def drive(
    track: int,
    begin_s: float,
    end_s: float,
    from_m: float,
    speed_mps: float,
    y_m: float = 5.2,
    off_m: float = 0.2,
) -> Sightings:
    """A car's sightings, each so far off."""
    time_s = np.arange(begin_s, end_s, 1 / FPS)
    rng = np.random.default_rng(track)
    # A sighting is of the near end; the middle of a car is 2.25 m on.
    x = from_m - 2.25 + speed_mps * (time_s - begin_s)
    points = np.column_stack([x, np.full(len(x), y_m)]) + rng.normal(0, off_m, (len(x), 2))
    n = len(x)
    return Sightings(
        np.full(n, track),
        time_s,
        points,
        np.tile(np.eye(2) * 0.04, (n, 1, 1)),
        np.tile([1.0, 0.0], (n, 1)),
        np.zeros(n, dtype=np.int64),
        np.zeros((n, 4), dtype=np.float32),
    )


def judged(parts: list[Sightings], until_s: float) -> list[StoppedVehicleJudge]:
    """A judge that has looked once a second, as it was each time."""
    every = Sightings.join(parts)
    judge, history = StoppedVehicleJudge(SEGMENT), []
    for now_s in np.arange(1.0, until_s + 0.5, 1.0):
        window = every.take((every.time_s <= now_s) & (every.time_s > now_s - 13.0))
        judge.update(float(now_s), window if len(window) else None)
        copy = StoppedVehicleJudge(SEGMENT)
        copy.standing = judge.standing
        history.append(copy)
    return history


def test_a_vehicle_that_stops_is_told_with_lane_place_and_time() -> None:
    """It stands at 40 m from second 4 on; five seconds later it is told."""
    history = judged([drive(1, 0, 4, 0, 10.0), drive(1, 4, 14, 40.0, 0.0)], 13)
    first = next(i for i, judge in enumerate(history) if judge.standing)
    assert 9 <= first + 1 <= 11
    (vehicle,) = history[-1].standing
    assert vehicle.lane == 1
    assert vehicle.along_m == pytest.approx(40.0, abs=0.3)
    assert vehicle.since_s == pytest.approx(4.0, abs=0.4)


@pytest.mark.parametrize("seed", range(5))
def test_boxes_that_jump_do_not_hide_it(seed: int) -> None:
    """Far away a single sighting is off by more than what counts as having come to stand."""
    history = judged([drive(seed, 0, 20, 40, 0, off_m=0.8)], 20)
    assert all(len(judge.standing) == 1 for judge in history[8:])
    assert history[-1].standing[0].along_m == pytest.approx(40.0, abs=1.5)


@pytest.mark.parametrize("speed_mps", [0.9, 3.0])
def test_slow_traffic_does_not_stand(speed_mps: float) -> None:
    """Walking pace is no event."""
    assert not any(judge.standing for judge in judged([drive(1, 0, 20, 5, speed_mps)], 20))


def test_occlusion_does_not_end_it_nor_begin_another() -> None:
    """Hidden for eight seconds, then another track: the same vehicle, since the same time."""
    history = judged([drive(1, 0, 10, 40, 0), drive(2, 18, 30, 40.5, 0)], 30)
    assert all(len(judge.standing) == 1 for judge in history[8:])
    (vehicle,) = history[-1].standing
    assert vehicle.since_s == pytest.approx(0.0, abs=0.2)
    assert vehicle.track == 2


def test_hidden_again_and_again_it_is_one_event() -> None:
    """Hidden for 1.5 s in every 5 s, a new track each time, none seen for long enough to stand."""
    parts = [
        drive(2 + n, begin_s, begin_s + 3.5, 40, 0) for n, begin_s in enumerate(range(11, 46, 5))
    ]
    history = judged([drive(1, 0, 9.5, 40, 0), *parts], 45)
    assert all(len(judge.standing) == 1 for judge in history[8:])
    (vehicle,) = history[-1].standing
    assert vehicle.since_s == pytest.approx(0.0, abs=0.2)
    assert vehicle.seen_s > 43


@pytest.mark.parametrize("speed_mps", [1.0, 5.0])
def test_who_drives_through_its_place_does_not_continue_it(speed_mps: float) -> None:
    """One at walking pace, and others one after the other."""
    starts = [12.0] if speed_mps < 2 else list(range(12, 28, 2))
    parts = [drive(2 + n, at, at + 16, 30, speed_mps) for n, at in enumerate(starts)]
    assert not judged([drive(1, 0, 10, 40, 0), *parts], 27)[-1].standing


def test_what_passes_before_it_is_not_taken_for_it() -> None:
    """Another vehicle drives through the next lane and past it while it is hidden."""
    parts = [drive(1, 0, 10, 40, 0), drive(2, 9, 15, 0, 15.0), drive(3, 9, 15, 0, 15.0, y_m=1.7)]
    history = judged(parts, 18)
    assert [vehicle.track for vehicle in history[17].standing] == [1]


def test_it_ends_when_the_vehicle_moves_on() -> None:
    """Within two seconds or so, in the segment or beyond it."""
    for begin_m in (40.0, 94.0):
        history = judged([drive(1, 0, 10, begin_m, 0), drive(1, 10, 16, begin_m, 6.0)], 14)
        assert history[9].standing
        assert not history[12].standing


def test_it_ends_when_the_vehicle_is_gone() -> None:
    """Nothing seen at its place for 15 s."""
    history = judged([drive(1, 0, 10, 40, 0)], 30)
    assert history[23].standing
    assert not history[25].standing


def test_a_fault_of_the_camera_ends_all() -> None:
    """What was seen before it may have been wrong."""
    judge = judged([drive(1, 0, 10, 40, 0)], 10)[-1]
    judge.reset()
    assert judge.standing == ()

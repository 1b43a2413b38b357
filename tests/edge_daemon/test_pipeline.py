"""From frames to states, on rendered video with the shipped detector."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from edge_daemon.camera import Camera, load_camera
from edge_daemon.detection import Detections, open_detector
from edge_daemon.frame import Frame
from edge_daemon.pipeline import Pipeline
from edge_daemon.settings import (
    DetectorSettings,
    SourceSettings,
    StabilitySettings,
)
from edge_daemon.sources import open_source
from slipstream.errors import InputError
from slipstream.messages import SegmentState

from .conftest import project


class Blind:
    """A detector that finds nothing."""

    def detect(self, image: np.ndarray) -> Detections:  # type: ignore[type-arg]
        return Detections(
            np.empty((0, 4), np.float32), np.empty(0, np.float32), np.empty(0, np.int64)
        )


def a_pipeline(camera: Camera, detector: object = None) -> Pipeline:
    """A pipeline with default settings."""
    return Pipeline(
        "rsu",
        camera,
        detector or Blind(),  # type: ignore[arg-type]
        StabilitySettings(),
        10.0,
    )


def watch(folder: Path) -> SegmentState:
    """The last state after the whole clip."""
    camera = load_camera(folder / "camera.toml")
    pipeline = a_pipeline(camera, open_detector(DetectorSettings()))
    for frame in open_source(SourceSettings(clip=folder / "video.mp4", pace="fast")).frames():
        assert frame is not None
        pipeline.process(frame)
    (state,) = pipeline.states(1)
    return state


def truth(folder: Path, window_s: float = 10.0) -> tuple[float, float, float, float]:
    """True mean speed, spread, acceleration variance and density in the last window."""
    segment = load_camera(folder / "camera.toml").segments[0]
    with (folder / "truth.csv").open() as file:
        rows = [{k: v for k, v in row.items() if k != "class"} for row in csv.DictReader(file)]
    data = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    last = data["time_s"].max()
    chosen = data["time_s"] > last - window_s
    chosen[chosen] = segment.contains(np.column_stack([data["x_m"], data["y_m"]])[chosen])
    speed, acceleration = data["speed_mps"][chosen], data["acceleration_mps2"][chosen]
    frames = window_s * 15
    return (
        float(speed.mean()),
        float(speed.std()),
        float(acceleration.var()),
        float(chosen.sum() / frames / segment.length_m),
    )


@pytest.fixture(scope="module")
def calm(street_clips: dict[str, Path]) -> SegmentState:
    """The last state of the calm clip."""
    return watch(street_clips["stable"])


@pytest.mark.long
def test_calm_video_is_stable(street_clips: dict[str, Path], calm: SegmentState) -> None:
    """y_e = 1, and the features are close to the truth behind the video."""
    state = calm
    mean, spread, variance, density = truth(street_clips["stable"])
    assert (state.y_e, state.reason) == (1, None)
    assert state.segment == "stable_road"
    assert state.coverage == pytest.approx(1.0, abs=0.02)
    assert state.features is not None
    assert state.features.mean_speed_mps.value == pytest.approx(mean, abs=0.5)
    assert state.features.speed_std_mps.value == pytest.approx(spread, abs=0.5)
    assert state.features.acceleration_variance_m2ps4.value == pytest.approx(variance, abs=0.4)
    assert state.features.density_veh_per_m.value == pytest.approx(density, rel=0.3)


@pytest.mark.long
def test_stop_and_go_video_is_turbulent(street_clips: dict[str, Path]) -> None:
    """y_e = 0 with a CV far above the threshold, as in the truth."""
    state = watch(street_clips["turbulent"])
    mean, spread, _, _ = truth(street_clips["turbulent"])
    assert state.y_e == 0
    assert state.features is not None
    assert state.features.mean_speed_mps.value == pytest.approx(mean, abs=1.0)
    assert state.features.speed_std_mps.value == pytest.approx(spread, rel=0.35)


@pytest.mark.long
def test_the_same_video_gives_the_same_state(
    street_clips: dict[str, Path], calm: SegmentState
) -> None:
    """Same input, same output, to the last digit."""
    assert watch(street_clips["stable"]) == calm


@pytest.mark.nightly
def test_states_taken_one_by_one_are_of_the_moment_when_they_were_begun(
    street_clips: dict[str, Path],
) -> None:
    """Frames that come while the segments are told do not change what is told of them."""
    folder = street_clips["stable"]
    camera = load_camera(folder / "camera.toml")
    pipelines = [a_pipeline(camera, open_detector(DetectorSettings())) for _ in range(2)]
    source = open_source(SourceSettings(clip=folder / "video.mp4", pace="fast"))
    frames = [frame for frame in source.frames() if frame is not None]
    for pipeline in pipelines:
        for frame in frames[:-20]:
            pipeline.process(frame)
    expected = pipelines[0].states(1)
    begun = pipelines[1].iter_states(1)
    for frame in frames[-20:]:
        pipelines[1].process(frame)
    assert list(begun) == expected
    assert expected[0].features is not None
    assert pipelines[1].states(1)[0].features != expected[0].features


def blank(time_s: float, *, cut: bool = False) -> Frame:
    """A black picture."""
    return Frame(np.zeros((720, 1280, 3), np.uint8), time_s, 0, 0.0, cut)


@pytest.mark.slow
def test_an_empty_road_is_unknown_and_never_stable(camera: Camera) -> None:
    """No vehicle, no flag."""
    pipeline = a_pipeline(camera)
    for number in range(330):
        pipeline.process(blank(number / 30))
    (state,) = pipeline.states(1)
    assert (state.y_e, state.reason, state.vehicles) == (None, "too_few_vehicles", 0)
    assert state.frames == pytest.approx(300, abs=1)


@pytest.mark.slow
def test_a_camera_that_falls_silent_becomes_unknown(camera: Camera) -> None:
    """The window empties with the time since the last frame."""
    pipeline = a_pipeline(camera)
    assert pipeline.states(1)[0].reason == "no_frames"
    for number in range(330):
        pipeline.process(blank(number / 30))
    (state,) = pipeline.states(1, idle_s=4.0)
    assert (state.reason, state.coverage) == ("window_not_covered", pytest.approx(0.6, abs=0.02))
    (state,) = pipeline.states(1, idle_s=11.0)
    assert (state.reason, state.frames) == ("no_frames", 0)


def standing(place_m: float) -> Detections:
    """A car at a place of the right lane."""
    ((u, v),) = project([(place_m, 1.75)])
    box = np.array([[u - 20, v - 30, u + 20, v]], dtype=np.float32)
    return Detections(box, np.full(1, 0.9, np.float32), np.zeros(1, np.int64))


def cars_at(places_m: Sequence[float]) -> Detections:
    """Cars in the right lane, those that are in view."""
    seen = [standing(place) for place in places_m if 5.0 < place < 95.0]
    seen = seen or [Blind().detect(np.empty(0))]
    boxes, scores, classes = (
        np.concatenate([getattr(one, name) for one in seen])
        for name in ("boxes", "scores", "classes")
    )
    return Detections(boxes, scores, classes)


def test_who_stands_ends_though_the_camera_is_silent_for_longer_than_the_window(
    camera: Camera,
) -> None:
    """Time does not step when the last frame leaves the window, without a fault of the camera."""
    pipeline = a_pipeline(camera)
    last_s = 10.0
    for time_s in np.arange(100.0, 100.0 + last_s, 0.2):
        pipeline.update(blank(float(time_s)), standing(50.0))
    told = {}
    for idle_s in (0.0, 9.0, 11.0, 14.0, 17.0, 30.0):
        time_ns = round((last_s + idle_s) * 1e9)
        (state,) = pipeline.states(time_ns, idle_s)
        told[idle_s] = pipeline.stopped(state).vehicles
    assert [len(vehicles) for vehicles in told.values()] == [1, 1, 1, 1, 0, 0]
    begun_s = [vehicle.since_ns / 1e9 for vehicles in told.values() for vehicle in vehicles]
    assert begun_s == [pytest.approx(0.2, abs=0.3)] * 4


def test_who_stood_before_a_cut_does_not_stand_after_it(camera: Camera) -> None:
    """A clip loops to a scene without it, then to one with a vehicle at the same place."""
    pipeline = a_pipeline(camera)
    told = {}
    for number in range(72):
        time_s = number / 4
        there = not 8.0 <= time_s < 10.0
        seen = standing(50.0) if there else Blind().detect(np.empty(0))
        pipeline.update(blank(time_s, cut=time_s in (8.0, 10.0)), seen)
        if time_s in (7.0, 8.0, 9.0, 10.0, 12.0, 14.0, 17.0):
            (state,) = pipeline.states(round(time_s * 1e9))
            told[time_s] = pipeline.stopped(state).vehicles
    assert {time_s for time_s, vehicles in told.items() if vehicles} == {7.0, 17.0}
    (vehicle,) = told[17.0]
    assert vehicle.since_ns / 1e9 == pytest.approx(10.0, abs=0.3)


@pytest.mark.parametrize(
    ("speed_mps", "cars", "reason"),
    [(15.0, 6, "opposite_direction"), (15.0, 2, "too_few_vehicles"), (-15.0, 6, None)],
)
def test_a_segment_that_is_drawn_against_its_traffic_says_so(
    camera: Camera, speed_mps: float, cars: int, reason: str | None
) -> None:
    """It leads towards the camera; some vehicles may be of a lane beside it."""
    pipeline = a_pipeline(camera)
    for number in range(101):
        time_s = number / 10
        begin_m = 90.0 if speed_mps < 0 else 10.0
        places = [begin_m + speed_mps * (time_s - 1.6 * car) for car in range(cars)]
        pipeline.update(blank(time_s), cars_at(places))
    (state,) = pipeline.states(1)
    assert state.reason == reason
    assert (state.y_e is None) == (reason is not None)


@pytest.mark.parametrize(
    ("before", "reason"), [(6, "wrong_way"), (2, "too_few_vehicles"), (0, "too_few_vehicles")]
)
def test_who_drives_the_wrong_way_closes_the_road_for_a_window(
    camera: Camera, before: int, reason: str
) -> None:
    """Where traffic was seen to run along the segment; else nobody knows which way is wrong."""
    pipeline = a_pipeline(camera)
    turns_s = 2.0 * before + 8.0
    told = {}
    for number in range(round(10 * (turns_s + 25.0))):
        time_s = number / 10
        places = [95.0 - 15.0 * (time_s - 2.0 * car) for car in range(before)]
        places.append(10.0 + 12.0 * (time_s - turns_s))
        pipeline.update(blank(time_s), cars_at(places))
        if number % 10 == 0:
            (state,) = pipeline.states(round(time_s * 1e9) + 1)
            told[round(time_s)] = state.reason
    assert told[round(turns_s) + 7] == reason
    assert told[round(turns_s) + 24] == "too_few_vehicles"
    assert all(each != "wrong_way" for at, each in told.items() if at < turns_s)


def test_a_pause_of_the_source_does_not_count_as_watched(camera: Camera) -> None:
    """Frames before and after a hole do not cover it."""
    pipeline = a_pipeline(camera)
    for time_s in [*np.arange(0, 3, 1 / 30), *np.arange(7, 10, 1 / 30)]:
        pipeline.process(blank(float(time_s)))
    (state,) = pipeline.states(1)
    assert state.reason == "window_not_covered"
    assert state.coverage == pytest.approx(0.6, abs=0.02)


def test_a_camera_of_a_frame_a_second_is_told_from_one_that_paused(camera: Camera) -> None:
    """Nothing can be followed from one frame to the next: the reason says so."""
    pipeline = a_pipeline(camera)
    for number in range(12):
        pipeline.process(blank(float(number)))
    (state,) = pipeline.states(1)
    assert (state.reason, state.coverage) == ("low_frame_rate", 0.0)


def test_a_picture_of_another_size_is_refused(camera: Camera) -> None:
    """The calibration holds for one size only."""
    frame = Frame(np.zeros((480, 640, 3), np.uint8), 0.0, 0, 0.0)
    with pytest.raises(InputError, match="640×480"):
        a_pipeline(camera).process(frame)

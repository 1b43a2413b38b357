"""Vehicles are counted once, in the quarter hour in which they pass, and what was not watched is
told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pytest

from edge_daemon.camera import Camera
from edge_daemon.detection import Detections
from edge_daemon.frame import Frame
from edge_daemon.pipeline import Pipeline
from edge_daemon.settings import StabilitySettings
from slipstream.messages import Estimate, SegmentCounts

from ..conftest import project

pytestmark = pytest.mark.slow

FPS = 10
QUARTER_S = 900
NOON_S = 1_700_000_100.0 // QUARTER_S * QUARTER_S
PICTURE = np.zeros((720, 1280, 3), np.uint8)
BEFORE_M, LINE_M = 90.0, 50.0
"""The segment leads from 80 m to 20 m, towards the camera."""

Drive = Callable[[float], float | None]
"""Where a vehicle is at a time, as distance from the camera; None: it is not seen."""


class Nothing:
    """A detector that is not asked."""

    def detect(self, image: object) -> Detections:
        raise AssertionError(image)


class Watched:
    """A pipeline that looks at vehicles, and what it has told."""

    def __init__(self, camera: Camera, utc_s: float = NOON_S) -> None:
        self.pipeline = Pipeline("rsu", camera, Nothing(), StabilitySettings(), 10.0)
        self.utc_s, self.media_s = utc_s, 100.0
        self.complete: list[SegmentCounts] = []

    def look(
        self,
        seconds: float,
        drives: Iterable[Drive] = (),
        *,
        kind: int = 0,
        cut: bool = False,
        fault: bool = False,
        silent: bool = False,
    ) -> None:
        """So long, with vehicles whose times begin now."""
        drives, began_s = list(drives), self.media_s
        for number in range(round(seconds * FPS)):
            self.media_s = began_s + (number + 1) / FPS
            self.utc_s += 1 / FPS
            time_ns = round(self.utc_s * 1e9)
            if not fault and not silent:
                places = [drive(self.media_s - began_s) for drive in drives]
                frame = Frame(PICTURE, self.media_s, time_ns, 0.0, cut and number == 0)
                self.pipeline.update(frame, boxes([p for p in places if p is not None], kind))
            if number % FPS == FPS - 1:
                idle_s = (number + 1) / FPS if silent else 0.0
                self.pipeline.states(time_ns, idle_s, "dark" if fault else None)
                self.complete += self.pipeline.counts.complete("approach")

    def fail(self) -> None:
        """A fault of the camera begins."""
        self.pipeline.reset()

    @property
    def running(self) -> SegmentCounts:
        """What is told of the running quarter hour."""
        self.pipeline.finish_counts()
        told = self.pipeline.counts.running("approach")
        assert told is not None
        SegmentCounts.read(told.to_bytes())
        return told

    @property
    def number(self) -> float:
        return self.running.vehicles.value


def boxes(places_m: list[float], kind: int = 0) -> Detections:
    """Vehicles in the right lane."""
    if not places_m:
        return Detections(
            np.empty((0, 4), np.float32), np.empty(0, np.float32), np.empty(0, np.int64)
        )
    feet = project([(place, 1.75) for place in places_m])
    box = np.column_stack([feet[:, 0] - 20, feet[:, 1] - 30, feet[:, 0] + 20, feet[:, 1]])
    n = len(places_m)
    return Detections(
        box.astype(np.float32), np.full(n, 0.9, np.float32), np.full(n, kind, np.int64)
    )


def drive(speed_mps: float, after_s: float = 0.0, from_m: float = BEFORE_M) -> Drive:
    """At one speed from a place on, out of view at its end."""

    def place(time_s: float) -> float | None:
        at_m = from_m - speed_mps * (time_s - after_s)
        return at_m if time_s >= after_s and 5.0 < at_m < 95.0 else None

    return place


def stop_at(stop_m: float, for_s: float, after_s: float = 0.0) -> Drive:
    """At 10 m/s to a place, where it waits, and on with 2 m/s²."""

    def place(time_s: float) -> float | None:
        driven_s = time_s - after_s
        arrives_s = (BEFORE_M - stop_m) / 10.0
        at_m = BEFORE_M - 10.0 * min(driven_s, arrives_s)
        at_m -= max(0.0, driven_s - arrives_s - for_s) ** 2
        return at_m if driven_s >= 0 and at_m > 5.0 else None

    return place


def hidden(whole: Drive, begin_m: float, end_m: float) -> Drive:
    """A drive that is not seen between two places."""

    def place(time_s: float) -> float | None:
        at_m = whole(time_s)
        return None if at_m is not None and end_m < at_m < begin_m else at_m

    return place


def test_vehicles_that_pass_count_once_with_class_and_speed(camera: Camera) -> None:
    """Nine of 15 m/s and three of 20 m/s, all trucks."""
    watched = Watched(camera)
    fast = [drive(20.0, 40.0 + 4.0 * n) for n in range(3)]
    watched.look(60, [*(drive(15.0, 4.0 * n) for n in range(9)), *fast], kind=1)
    told = watched.running
    assert told.vehicles.value == 12
    assert {one.vehicle_class: one.vehicles.value for one in told.classes} == {
        "car": 0,
        "truck": 12,
        "bus": 0,
        "motorcycle": 0,
    }
    assert told.watched_s == pytest.approx(60, abs=0.2)
    assert told.reason is None
    assert told.speeds == 12
    assert told.mean_speed_mps is not None
    assert told.v85_mps is not None
    assert told.mean_speed_mps.value == pytest.approx(16.25, abs=0.2)
    assert told.v85_mps.value == pytest.approx(20.0, abs=0.3)


def test_one_that_stops_before_the_cross_section_counts_when_it_goes_on(camera: Camera) -> None:
    """Its middle is a car's half nearer to the camera's far side than its foot."""
    watched = Watched(camera)
    stopping = stop_at(60.0, 15.0)
    watched.look(16, [stopping])
    assert watched.number == 0
    watched.look(12, [lambda time_s: stopping(time_s + 16)])
    assert watched.number == 1


@pytest.mark.parametrize("off_m", [-3.0, -2.25, -1.5, 0.0])
def test_one_that_stands_on_the_cross_section_and_goes_on_counts_once(
    camera: Camera, off_m: float
) -> None:
    """Its box jumps by more than it is off the line."""
    watched = Watched(camera)
    rng = np.random.default_rng(3)
    whole = stop_at(LINE_M + off_m, 12.0)

    def jumping(time_s: float) -> float | None:
        at_m = whole(time_s)
        return None if at_m is None else at_m + rng.normal(0.0, 0.5)

    watched.look(24, [jumping])
    assert watched.number == 1


def test_a_queue_that_dissolves_counts_each_of_it_once(camera: Camera) -> None:
    """Five stand behind one another across the line for a red light, three with their middles
    past it.
    """
    watched = Watched(camera)
    queue = [stop_at(30.0 + 8.0 * n, 15.0, 2.0 * n) for n in range(5)]
    watched.look(17, queue)
    stood = watched.number
    watched.look(22, [lambda time_s, one=one: one(time_s + 17) for one in queue])  # type: ignore[misc]
    assert stood == 3
    assert watched.number == 5


def test_oncoming_vehicles_do_not_count(camera: Camera) -> None:
    """Nor one that comes, turns round after the line and leaves as it came."""
    watched = Watched(camera)
    watched.look(30, [drive(-15.0, 3.0 * n, from_m=10.0) for n in range(8)])
    assert watched.number == 0


def test_a_track_that_breaks_at_the_cross_section_counts_once_and_less_surely(
    camera: Camera,
) -> None:
    """It is hidden for two seconds, by when its track has ended; one that is seen only after the
    line has passed it, too.
    """
    seen, joined, late = Watched(camera), Watched(camera), Watched(camera)
    seen.look(10, [drive(10.0)])
    joined.look(10, [hidden(drive(10.0), 60.0, 40.0)])
    late.look(4, [])
    late.look(10, [hidden(drive(10.0), 95.0, 42.0)])
    assert (seen.number, joined.number, late.number) == (1, 1, 1)
    errors = [one.running.vehicles.standard_error for one in (seen, joined, late)]
    assert errors == sorted(errors)  # type: ignore[type-var]
    assert errors[0] != errors[1]


def test_a_track_that_breaks_after_the_cross_section_does_not_count_again(camera: Camera) -> None:
    """Moving, and standing in a queue behind others."""
    moving, standing = Watched(camera), Watched(camera)
    moving.look(10, [hidden(drive(10.0), 40.0, 26.0)])
    whole = stop_at(35.0, 40.0)
    standing.look(60, [lambda t: None if 20 < t < 35 else whole(t)])
    assert (moving.number, standing.number) == (1, 1)


def test_a_vehicle_that_is_lost_before_the_cross_section_widens_the_error(camera: Camera) -> None:
    """Whether it passed is not known: it is not counted."""
    watched, empty = Watched(camera), Watched(camera)
    watched.look(30, [hidden(drive(10.0), 58.0, 0.0)])
    empty.look(30)
    assert watched.number == empty.number == 0
    assert empty.running.vehicles.standard_error == 0.0
    assert watched.running.vehicles.standard_error == pytest.approx(0.5**0.5)


def test_a_fault_in_between_is_no_watched_time_nor_are_the_seconds_before_it(
    camera: Camera,
) -> None:
    """What passed in the window before the fault is not counted either, as it may have begun."""
    watched = Watched(camera)
    watched.look(60, [drive(15.0, 10.0), drive(15.0, 52.0)])
    watched.fail()
    watched.look(30, fault=True)
    watched.look(60, [drive(15.0, 20.0)])
    told = watched.running
    assert told.vehicles.value == 2
    assert told.watched_s == pytest.approx(110, abs=0.5)
    assert told.elapsed_s == pytest.approx(150, abs=0.5)
    assert told.reason == "dark"
    flow, counted = told.flow_vph(told.vehicles), told.vehicles
    assert flow is not None
    assert flow.value == pytest.approx(2 / 110 * 3600, rel=0.01)
    assert flow.standard_error is not None
    assert counted.standard_error is not None
    assert flow.standard_error > 1.5 * counted.standard_error / 110 * 3600


def test_without_a_frame_no_flow_is_told_but_why(camera: Camera) -> None:
    """The quarter hour is complete all the same."""
    watched = Watched(camera, NOON_S)
    watched.look(QUARTER_S + 15, silent=True)
    (told,) = watched.complete
    assert (told.watched_s, told.reason, told.vehicles.value) == (0.0, "no_frames", 0)
    assert told.flow_vph(told.vehicles) is None
    assert told.mean_speed_mps is None


def test_a_slow_camera_has_watched_nothing(camera: Camera) -> None:
    """Frames that are a second apart follow no vehicle."""
    watched = Watched(camera)
    for _ in range(20):
        watched.look(0.9, silent=True)
        watched.look(0.1)
    assert watched.running.watched_s == pytest.approx(0.0, abs=0.5)


def test_each_vehicle_is_of_the_quarter_hour_in_which_it_passes(camera: Camera) -> None:
    """One passes four seconds before its end, one two seconds after it."""
    watched = Watched(camera, NOON_S + QUARTER_S - 30)
    watched.look(45, [drive(10.0, 22.0), drive(10.0, 28.0)])
    (told,) = watched.complete
    assert told.complete
    assert told.began_ns == round(NOON_S * 1e9)
    assert told.vehicles.value == 1
    assert told.watched_s == pytest.approx(30, abs=0.3)
    assert told.reason == "not_running"
    assert watched.number == 1
    assert watched.running.reason is None
    assert watched.pipeline.counts.complete("approach") == []


def test_a_clock_that_is_set_back_counts_no_vehicle_twice(camera: Camera) -> None:
    """The quarter hour that ran ends, and that of the clock begins, watched from now on."""
    watched = Watched(camera, NOON_S + 100)
    watched.look(50, [drive(15.0, 5.0), drive(15.0, 40.0)])
    watched.utc_s -= 1200
    watched.look(50, [drive(15.0, 10.0)])
    (ended,) = watched.complete
    assert (ended.began_ns, ended.vehicles.value) == (round(NOON_S * 1e9), 2)
    assert ended.watched_s == pytest.approx(50, abs=0.3)
    assert watched.running.began_ns == round((NOON_S - 2 * QUARTER_S) * 1e9)
    assert watched.number == 1
    assert watched.running.watched_s == pytest.approx(50, abs=0.3)
    assert watched.running.reason == "clock_jump"


def test_a_clock_that_is_set_back_within_the_quarter_hour_tells_it_twice(camera: Camera) -> None:
    """Both parts are of the same quarter hour; no part claims more watched time than it has."""
    watched = Watched(camera, NOON_S + 300)
    watched.look(50, [drive(15.0, 5.0)])
    watched.utc_s -= 200
    watched.look(50)
    (ended,) = watched.complete
    assert ended.began_ns == watched.running.began_ns == round(NOON_S * 1e9)
    assert (ended.vehicles.value, watched.number) == (1, 0)
    assert watched.running.watched_s == pytest.approx(50, abs=0.3)


def test_a_clip_that_loops_counts_who_passes_in_it_and_nobody_at_its_seam(camera: Camera) -> None:
    """At its begin one is upstream and one is past the line; at its end one is past it, too."""
    watched = Watched(camera)
    scene = [drive(10.0, -2.0), drive(10.0, -6.0), drive(10.0, 4.0)]
    for loop in range(4):
        watched.look(9, scene, cut=loop > 0)
    assert watched.number == 8
    assert watched.running.watched_s == pytest.approx(36, abs=0.5)


def test_the_error_of_a_flow_grows_with_what_was_not_watched(camera: Camera) -> None:
    """And the flow itself stays that of watched time."""
    watched = Watched(camera)
    watched.look(60)
    end_ns = round((NOON_S + QUARTER_S) * 1e9)
    whole = replace_counts(watched.running, end_ns, 900.0, 180.0)
    half = replace_counts(watched.running, end_ns, 450.0, 90.0)
    none = replace_counts(watched.running, end_ns, 59.0, 12.0)
    flows = [told.flow_vph(told.vehicles) for told in (whole, half, none)]
    assert flows[2] is None
    assert flows[0] is not None
    assert flows[1] is not None
    assert flows[0].value == flows[1].value == 720.0
    assert flows[0].standard_error == pytest.approx(4.0 * 2.0)
    assert flows[1].standard_error == pytest.approx(8.0 * (2.0**2 + 45.0) ** 0.5)


def replace_counts(
    told: SegmentCounts, until_ns: int, watched_s: float, vehicles: float
) -> SegmentCounts:
    """A complete quarter hour in its place."""
    return SegmentCounts(
        **{name: getattr(told, name) for name in told.__struct_fields__}
        | {
            "until_ns": until_ns,
            "complete": True,
            "watched_s": watched_s,
            "vehicles": Estimate(value=vehicles, standard_error=2.0),
        }
    )

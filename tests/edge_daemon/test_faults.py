"""The edge daemon through a camera's faults: what it says meanwhile, and how it comes back."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import numpy.typing as npt
import pytest

from edge_daemon import metrics
from edge_daemon.camera import Camera, load_camera
from edge_daemon.daemon import EdgeDaemon
from edge_daemon.detection import Detections
from edge_daemon.frame import Frame
from edge_daemon.pipeline import Pipeline
from edge_daemon.settings import EdgeSettings, WatchSettings
from edge_daemon.sources import FrameSource, SourceCounters
from edge_daemon.sources.camera import open_camera
from edge_daemon.sources.live import MAX_WAIT_S, LiveSource
from edge_daemon.watch import Watch
from edge_daemon.watch.faults.exposure import BrightJudge, DarkJudge
from edge_daemon.watch.faults.obscured import ObscuredJudge
from slipstream.config import ServiceSettings
from slipstream.messages import (
    CameraFault,
    RsuHealth,
    SegmentCounts,
    SegmentState,
    StoppedVehicles,
    capture_time_ns,
    roadside,
)
from slipstream.service import Service

from .cameras import Feed, RtspServer
from .conftest import project

Picture = npt.NDArray[np.uint8]

WINDOW_S = 4.0
FPS = 15
QUICK = WatchSettings(moved_after_s=1.5)


@pytest.fixture
def usual_times() -> None:
    """Leaves the times of faults as they are."""


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Faults begin and end some times sooner than they do on roads."""
    if "usual_times" in request.fixturenames:
        return
    for name, seconds in (
        ("watch.watch.SAMPLE_INTERVAL_S", 0.1),
        ("watch.watch.STALE_AFTER_S", 1.0),
        ("daemon.STALE_AFTER_S", 1.0),
        ("watch.watch._CLEAR_AFTER_S", 0.5),
        ("watch.faults.frozen._STILL_S", 1.5),
    ):
        monkeypatch.setattr(f"edge_daemon.{name}", seconds)
    for judge in (DarkJudge, BrightJudge, ObscuredJudge):
        monkeypatch.setattr(judge, "after_s", 0.3)


class Recorder:
    """Stands in for the bus and keeps what is published."""

    def __init__(self) -> None:
        self.states: list[SegmentState] = []
        self.health: list[RsuHealth] = []
        self.stopped: list[StoppedVehicles] = []
        self.counts: list[SegmentCounts] = []

    def publisher(self, key: str, **_: object) -> Recorder:
        """One for all keys."""
        return self

    def has_subscribers(self) -> bool:
        """Nobody looks at previews."""
        return False

    def put(self, message: Any) -> None:
        """Keep it."""
        if isinstance(message, StoppedVehicles):
            self.stopped.append(message)
        elif isinstance(message, SegmentCounts):
            self.counts.append(message)
        else:
            (self.states if isinstance(message, SegmentState) else self.health).append(message)

    def until(self, condition: Callable[[], bool], seconds: float) -> None:
        """Wait until the condition holds."""
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, self.health[-1:]
            time.sleep(0.05)


class Still:
    """A detector that sees the same vehicles in every picture, or those told for it."""

    requests = 1

    def __init__(self, told: dict[int, Detections] | None = None) -> None:
        self._told = told or {}

    def detect(self, image: Picture) -> Detections:
        """What was told for this picture."""
        nothing = Detections(
            np.zeros((0, 4), np.float32), np.zeros(0, np.float32), np.zeros(0, np.int64)
        )
        return self._told.get(id(image), nothing)


class Reel:
    """A source that shows frames made before."""

    def __init__(self, frames: list[Frame]) -> None:
        self.counters = SourceCounters()
        self._frames = frames

    def frames(self) -> Iterator[Frame]:
        """All of them."""
        return iter(self._frames)

    def close(self) -> None:
        """Nothing to release."""


def a_daemon(
    camera: Camera,
    source: FrameSource,
    detector: Still,
    pace: str,
    state_interval_s: float = 0.25,
) -> tuple[EdgeDaemon, Recorder, Service]:
    """A daemon with short windows that tells its states four times a second, or as often."""
    settings = EdgeSettings.model_validate(
        {
            "rsu": "r",
            "camera": "camera.toml",
            "source": {"clip": "clip.mp4", "pace": pace},
            "window_s": WINDOW_S,
            "state_interval_s": state_interval_s,
            "watch": QUICK,
        }
    )
    recorder = Recorder()
    service = Service("edge", ServiceSettings())
    pipeline = Pipeline("r", camera, detector, settings.stability, settings.window_s)
    watch = Watch(camera, settings.watch)
    daemon = EdgeDaemon(
        settings,
        camera,
        detector,
        pipeline,
        watch,
        source,
        recorder,  # type: ignore[arg-type]
        service,
    )
    return daemon, recorder, service


@pytest.fixture(scope="module")
def calm(street_clips: dict[str, Path]) -> tuple[Camera, list[Picture], list[Detections]]:
    """The calm clip's pictures with what a perfect detector sees in them."""
    folder = street_clips["stable"]
    boxes: dict[int, list[list[float]]] = {}
    for line in (folder / "truth.csv").read_text().splitlines()[1:]:
        cells = line.split(",")
        if float(cells[12]) > 0.6:
            boxes.setdefault(int(cells[0]), []).append([float(cell) for cell in cells[8:12]])
    capture = cv2.VideoCapture(str(folder / "video.mp4"))
    pictures = [np.asarray(capture.read()[1], dtype=np.uint8) for _ in range(14 * FPS)]
    seen = []
    for number in range(len(pictures)):
        found = np.array(boxes.get(number, []), dtype=np.float32).reshape(-1, 4)
        count = len(found)
        seen.append(Detections(found, np.full(count, 0.9, np.float32), np.zeros(count, np.int64)))
    return load_camera(folder / "camera.toml"), pictures, seen


def turned(picture: Picture) -> Picture:
    """Seen by a camera that was knocked 20 px aside."""
    return np.ascontiguousarray(np.roll(picture, 20, axis=1))


def torn(picture: Picture) -> Picture:
    """Half of it lost."""
    picture = picture.copy()
    picture[360:] = 128
    return picture


BEGIN, END = 6 * FPS, 9 * FPS


@pytest.mark.parametrize(
    ("reason", "spoil"),
    [
        ("frozen", None),
        pytest.param("dark", np.zeros_like, marks=pytest.mark.long),
        pytest.param("corrupt", torn, marks=pytest.mark.long),
        pytest.param("camera_moved", turned, marks=pytest.mark.long),
    ],
)
def test_a_fault_closes_all_segments_and_a_window_later_they_are_back(
    calm: tuple[Camera, list[Picture], list[Detections]],
    caplog: pytest.LogCaptureFixture,
    reason: str,
    spoil: Callable[[Picture], Picture] | None,
) -> None:
    """States, health, metrics and one log line at each end say why; then y_e is known again."""
    camera, pictures, seen = calm
    caplog.set_level(logging.WARNING)
    shown, told = [], {}
    for number in range(14 * FPS):
        picture = pictures[number].copy()
        if BEGIN <= number < END:
            picture = pictures[BEGIN].copy() if spoil is None else spoil(picture)
        time_s = number / FPS
        shown.append(Frame(picture, time_s, round(1e18 + 1e9 * time_s), time_s))
        still = spoil is None and BEGIN <= number < END
        told[id(picture)] = seen[BEGIN if still else number]
    begun = metrics.FAULTS.labels(reason)._value.get()
    daemon, recorder, _ = a_daemon(camera, Reel(shown), Still(told), "fast")
    daemon.run()
    at = np.array([state.time_ns / 1e9 - 1e9 for state in recorder.states[:-1]])
    flags = [state.y_e for state in recorder.states[:-1]]
    reasons = [state.reason for state in recorder.states[:-1]]
    first = reasons.index(reason)
    last = len(reasons) - 1 - reasons[::-1].index(reason)
    assert flags[first - 1] == 1  # it had been known until then
    assert BEGIN / FPS <= at[first] <= BEGIN / FPS + 2.5
    assert END / FPS - 0.3 <= at[last] <= END / FPS + 2.0
    assert set(reasons[first : last + 1]) == {reason}
    assert {state.frames for state in recorder.states[first : last + 1]} == {0}
    known_again = next(i for i in range(last, len(flags)) if flags[i] is not None)
    assert 0.8 * WINDOW_S <= at[known_again] - at[last] <= WINDOW_S + 1.5
    assert set(reasons[last + 1 : known_again]) <= {"window_not_covered", "too_few_vehicles"}
    assert flags[known_again] == 1
    assert {health.fault for health in recorder.health} == {None, reason}
    assert recorder.health[-1].fault is None
    assert metrics.FAULTS.labels(reason)._value.get() == begun + 1
    assert metrics.FAULT.labels(reason)._value.get() == 0
    lines = [r.getMessage() for r in caplog.records if reason in r.getMessage()]
    assert ["has a fault" in line for line in lines] == [True, False]


@pytest.mark.long
def test_a_road_on_which_nothing_that_moves_is_detected_is_not_empty(
    calm: tuple[Camera, list[Picture], list[Detections]], usual_times: None
) -> None:
    """A detector that finds nothing: named within 10 s, and until it finds what moves again."""
    camera, pictures, seen = calm
    watch = Watch(camera, WatchSettings())
    rounds = 2
    faults: list[str | None] = []
    for number in range(rounds * len(pictures)):
        time_s = number / FPS
        frame = Frame(pictures[number % len(pictures)], time_s, round(1e18 + 1e9 * time_s), time_s)
        finds = number >= len(pictures)
        boxes = seen[number % len(pictures)].boxes
        faults.append(watch.look(frame, boxes if finds else boxes[:0]))
    first = faults.index("blind")
    again = len(pictures)
    assert first / FPS <= 10.0
    assert set(faults[first:again]) == {"blind"}
    assert faults[-1] is None
    assert 0 < faults[again:].index(None) / FPS <= 10.0


def test_a_blind_detector_closes_the_segments(
    calm: tuple[Camera, list[Picture], list[Detections]],
) -> None:
    """The states say `blind`, and not that too few vehicles came by."""
    camera, pictures, _ = calm
    shown = [
        Frame(picture, n / FPS, n * 10**9 // FPS, n / FPS) for n, picture in enumerate(pictures)
    ]
    daemon, recorder, _ = a_daemon(camera, Reel(shown), Still(), "fast")
    daemon.run()
    assert recorder.states[-2].reason == "blind"
    assert recorder.health[-1].fault == "blind"


@pytest.mark.long
def test_a_clock_that_steps_empties_the_window(
    calm: tuple[Camera, list[Picture], list[Detections]],
) -> None:
    """The wall clock is set back by an hour: a declared reason, then known again."""
    camera, pictures, seen = calm
    shown, told = [], {}
    for number, picture in enumerate(pictures):
        time_s = number / FPS
        wall_s = time_s - (3600 if number >= BEGIN else 0)
        shown.append(Frame(picture, time_s, round(1e18 + 1e9 * wall_s), time_s))
        told[id(picture)] = seen[number]
    daemon, recorder, _ = a_daemon(camera, Reel(shown), Still(told), "fast")
    daemon.run()
    reasons = [state.reason for state in recorder.states]
    first = reasons.index("clock_jump")
    assert recorder.states[first - 1].y_e == 1
    assert recorder.states[first].time_ns < recorder.states[0].time_ns
    assert "window_not_covered" in reasons[first:]
    assert recorder.states[-2].y_e == 1


def test_pictures_of_another_size_are_corrupt_until_they_fit_again(
    calm: tuple[Camera, list[Picture], list[Detections]],
) -> None:
    """The source leaves them out and says so; the daemon gives the reason, not `stale`."""
    camera, pictures, _ = calm

    class Misfit(Reel):
        def frames(self) -> Iterator[Frame | None]:  # type: ignore[override]
            now = time.monotonic()
            for number, picture in enumerate(pictures[:5]):
                yield Frame(picture, number / FPS, time.time_ns(), now)
            self.counters.size_mismatch_s = time.monotonic()
            yield None

    daemon, recorder, _ = a_daemon(camera, Misfit([]), Still(), "real_time")
    daemon.run()
    assert "corrupt" in {health.fault for health in recorder.health}
    assert {told.segment for told in recorder.counts} == {s.id for s in camera.segments}


def test_a_clip_that_is_read_as_fast_as_it_goes_has_no_quarter_hours(
    calm: tuple[Camera, list[Picture], list[Detections]],
) -> None:
    """An hour of it takes minutes: nothing that is counted in it is of a time of day."""
    camera, pictures, _ = calm
    frames = [
        Frame(picture, number / FPS, time.time_ns(), time.monotonic())
        for number, picture in enumerate(pictures[:30])
    ]
    daemon, recorder, _ = a_daemon(camera, Reel(frames), Still(), "fast")
    daemon.run()
    assert recorder.states
    assert recorder.counts == []


def with_segments(camera: Camera, count: int) -> Camera:
    """The same camera with its first segment watched so many times."""
    several = copy(camera)
    first = camera.segments[0]
    several.segments = tuple(replace(first, id=f"s{n}") for n in range(count))
    return several


@pytest.mark.long
@pytest.mark.parametrize("step", [1, 5], ids=["15 a second", "3 a second"])
def test_segments_told_between_frames_are_all_told(
    calm: tuple[Camera, list[Picture], list[Detections]], step: int
) -> None:
    """Each of three segments at every beat, fewer frames than segments or not; health as often."""
    camera, pictures, seen = calm
    told = {id(p): s for p, s in zip(pictures, seen, strict=True)}
    frames = [
        Frame(pictures[n], n / FPS, n * 10**9 // FPS, time.monotonic())
        for n in range(0, len(pictures), step)
    ]
    daemon, recorder, _ = a_daemon(with_segments(camera, 3), Reel(frames), Still(told), "fast")
    daemon.run()
    *beats, last = [recorder.states[n : n + 3] for n in range(0, len(recorder.states), 3)]
    assert {tuple(state.segment for state in beat) for beat in [*beats, last]} == {
        ("s0", "s1", "s2")
    }
    assert all(len({state.time_ns for state in beat}) == 1 for beat in beats)
    assert len(beats) == pytest.approx(min(4, FPS / step) * len(pictures) / FPS, abs=2)
    assert abs(len(recorder.health) - len(beats)) <= 1
    for beat in beats:
        assert len({msgspec.structs.replace(state, segment="s", sequence=0) for state in beat}) == 1


@pytest.mark.long
def test_no_segment_is_judged_by_what_a_fault_made_untrusted(
    calm: tuple[Camera, list[Picture], list[Detections]],
) -> None:
    """A fault between two segments of a beat ends the beat; none tells a flag after it began."""
    camera, pictures, seen = calm
    pictures = [*pictures[: 6 * FPS], *(np.zeros_like(p) for p in pictures[6 * FPS :])]
    told = {id(p): s for p, s in zip(pictures, seen, strict=True)}
    frames = [
        Frame(picture, n / FPS, n * 10**9 // FPS, time.monotonic())
        for n, picture in enumerate(pictures)
    ]
    daemon, recorder, _ = a_daemon(with_segments(camera, 9), Reel(frames), Still(told), "fast")
    daemon.run()
    flags = [state.y_e for state in recorder.states]
    began = next(n for n, state in enumerate(recorder.states) if state.reason == "dark")
    assert 1 in flags[:began]
    assert set(flags[began:]) == {None}
    assert began % 9 != 0
    assert recorder.states[began].segment == "s0"


@pytest.mark.long
def test_a_live_camera_goes_through_every_fault_and_is_trusted_again(
    calm: tuple[Camera, list[Picture], list[Detections]], caplog: pytest.LogCaptureFixture
) -> None:
    """Over RTSP: freezes, goes black, stalls, is cut off, each told in time and left again."""
    camera, pictures, _ = calm
    caplog.set_level(logging.WARNING)
    chosen = [pictures[n] for n in range(0, 40, 4)]
    black = np.zeros_like(chosen[0])
    feed = Feed(lambda number: chosen[number % len(chosen)], fps=10)
    server = RtspServer(feed)
    source = open_camera(server.url, 1.5, camera.size)
    daemon, recorder, service = a_daemon(camera, source, Still(), "real_time")
    running = threading.Thread(target=daemon.run)
    running.start()

    def fault() -> str | None:
        return recorder.health[-1].fault if recorder.health else "none yet"

    def flowing() -> bool:
        return fault() is None and recorder.health[-1].status == "ok"

    try:
        recorder.until(flowing, 15)
        feed.picture = lambda _: chosen[0]
        recorder.until(lambda: fault() == "frozen", 10)
        feed.picture = lambda _: black
        recorder.until(lambda: fault() == "dark", 10)
        feed.picture = lambda number: chosen[number % len(chosen)]
        recorder.until(flowing, 10)
        feed.stalled = True
        recorder.until(lambda: fault() == "stale", 10)
        feed.stalled = False
        recorder.until(flowing, 10)
        feed.off = True
        recorder.until(lambda: fault() == "stale", 10)
        feed.off = False
        recorder.until(flowing, 15)
    finally:
        service.stopping.set()
        running.join(10)
        source.close()
        server.close()
    assert not running.is_alive()
    told = [state for state in recorder.states if state.reason in {"frozen", "dark", "stale"}]
    assert {state.y_e for state in told} == {None}
    assert {"frozen", "dark", "stale"} <= {state.reason for state in told}


def test_what_was_skipped_keeps_its_marks(
    calm: tuple[Camera, list[Picture], list[Detections]],
) -> None:
    """A jump of the clock is not lost with the one frame that had no room to wait."""
    picture = calm[1][0]
    offered = threading.Event()

    def capture(offer: Callable[[Frame], None], *_: object) -> None:
        frame = Frame(picture, 0.0, 0, 0.0)
        offer(replace(frame, clock_jump=True, cut=True))
        offer(replace(frame, captured_s=0.5 * MAX_WAIT_S))
        offer(replace(frame, captured_s=1.1 * MAX_WAIT_S))
        offered.set()

    source = LiveSource(capture, "test")  # type: ignore[arg-type]
    assert offered.wait(60)
    frames = list(source.frames())
    marks = [(frame.clock_jump, frame.cut) for frame in frames if frame is not None]
    assert marks == [(True, True), (False, False)]
    assert source.counters.skipped == 1


def stopping_twice(camera: Camera, cut_s: float, fault_s: float) -> tuple[EdgeDaemon, Recorder]:
    """A car stands for 8 s and drives on, and so does another one after it; four frames a second.

    At a time the scene is cut, and from another one on the camera has a fault.
    """
    pictures = [np.full((720, 1280, 3), level, np.uint8) for level in (60, 90)]
    shown, told = [], {}
    for number in range(88):
        time_s = number / 4
        image = pictures[number % 2][:]
        shown.append(Frame(image, time_s, round(1e18 + 1e9 * time_s), time_s, cut=time_s == cut_s))
        ((u, v),) = project([(60.0 - 6.0 * max(0.0, time_s % 11 - 8.0), 1.75)])
        box = np.array([[u - 20, v - 30, u + 20, v]], dtype=np.float32)
        told[id(image)] = Detections(box, np.full(1, 0.9, np.float32), np.zeros(1, np.int64))

    class Scripted(Watch):
        def look(self, frame: Frame, *_: object) -> CameraFault | None:
            return "dark" if frame.media_time_s >= fault_s else None

    daemon, recorder, _ = a_daemon(camera, Reel(shown), Still(told), "fast", 1.0)
    daemon._watch = Scripted(camera, QUICK)
    return daemon, recorder


def stopped_lines(caplog: pytest.LogCaptureFixture) -> list[str]:
    """What the journal has about vehicles that stand."""
    lines = [record.getMessage() for record in caplog.records]
    return [line for line in lines if "stopped" in line or "stands" in line]


@pytest.mark.slow
def test_who_stands_is_told_until_once_that_nobody_does(
    camera: Camera, caplog: pytest.LogCaptureFixture
) -> None:
    """With each state while one stands, then one empty message; a red light is not logged."""
    daemon, recorder = stopping_twice(camera, np.inf, np.inf)
    daemon.run()
    counts = [len(message.vehicles) for message in recorder.stopped]
    changes = [after for before, after in pairwise([0, *counts]) if before != after]
    assert changes == [1, 0, 1, 0]
    assert counts.count(0) == 2
    assert counts.count(1) >= 6
    told = {state.time_ns for state in recorder.states}
    assert {message.time_ns for message in recorder.stopped} <= told
    assert stopped_lines(caplog) == []


@pytest.mark.slow
def test_a_breakdown_is_logged_at_most_once_a_minute(
    camera: Camera, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line at its beginning, with lanes counted from one, and one at its end."""
    monkeypatch.setattr(roadside, "STANDS_LONG_S", 5.0)
    daemon, recorder = stopping_twice(camera, np.inf, np.inf)
    daemon.run()
    place = next(message.vehicles[0] for message in recorder.stopped)
    assert stopped_lines(caplog) == [
        f"approach: 1 stopped as in no queue, the first in lane {place.lane + 1} from the right "
        f"at {place.along_m:.0f} m",
        "approach: no vehicle stands any more",
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("cut_s", "fault_s"), [(7.0, np.inf), (np.inf, 7.0)])
def test_nobody_says_that_the_road_is_clear_who_cannot_see_it(
    camera: Camera,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    cut_s: float,
    fault_s: float,
) -> None:
    """A fault or a cut while one stands: no message, and the journal does not say it has gone."""
    monkeypatch.setattr(roadside, "STANDS_LONG_S", 5.0)
    daemon, recorder = stopping_twice(camera, cut_s, fault_s)
    daemon.run()
    before = [message for message in recorder.stopped if message.time_ns < 1e18 + 11e9]
    assert {len(message.vehicles) for message in before} == {1}
    assert before[-1].time_ns < 1e18 + 7e9
    assert len(stopped_lines(caplog)) == 1


class Viewer(Recorder):
    """Looks at the previews, and keeps them."""

    def __init__(self) -> None:
        super().__init__()
        self.pictures: list[bytes] = []

    def has_subscribers(self) -> bool:
        """Somebody looks."""
        return True

    def put(self, message: Any) -> None:
        """Keep it."""
        if isinstance(message, bytes):
            self.pictures.append(message)
        else:
            super().put(message)


def test_a_camera_that_stopped_leaves_no_picture_that_looks_live(
    calm: tuple[Camera, list[Picture], list[Detections]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its last picture is sent again without colour, and still says when it was taken."""
    camera, pictures, _ = calm
    taken_ns, taken_s = time.time_ns(), time.monotonic() - 5.0
    seen = [Frame(pictures[n], n / FPS, taken_ns, taken_s) for n in range(3)]
    viewer = Viewer()
    monkeypatch.setattr(sys.modules[__name__], "Recorder", lambda: viewer)
    daemon, *_ = a_daemon(camera, Reel([*seen, None, None]), Still(), "real_time")  # type: ignore[list-item]
    daemon.run()
    assert {capture_time_ns(jpeg) for jpeg in viewer.pictures} == {taken_ns}
    shown = [
        np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR), dtype=np.int64)
        for jpeg in viewer.pictures
    ]
    colours = [float(np.percentile(np.ptp(picture, axis=2), 90)) for picture in shown]
    # Boxed and bare: two of a frame at least, two a second without one, and two at the end.
    assert len(colours) >= 8
    assert min(colours[:2]) > 20 > max(colours[-6:])

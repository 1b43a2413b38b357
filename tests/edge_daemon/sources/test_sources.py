"""Clips and cameras as sources of frames."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import Queue
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from edge_daemon.frame import Frame
from edge_daemon.settings import SourceSettings
from edge_daemon.sources import FrameSource, open_source
from edge_daemon.sources.camera import open_camera, without_password
from edge_daemon.sources.clip import ClipFrame, open_clip, paced_clip
from edge_daemon.sources.live import Capture, LiveSource
from edge_daemon.sources.protocol import SourceCounters
from slipstream.config import check
from slipstream.errors import InputError

from ..cameras import take

FRAMES, FPS = 45, 30


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video of 1.5 s whose brightness tells the frame."""
    path = tmp_path_factory.mktemp("clip") / "video.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), FPS, (320, 180))
    for number in range(FRAMES):
        writer.write(np.full((180, 320, 3), 20 + 4 * number, dtype=np.uint8))
    writer.release()
    return path


def taken(source: FrameSource, limit: int = 10**6) -> list[Frame]:
    """Frames until the source ends or enough have come."""
    frames = []
    for frame in source.frames():
        if frame is not None:
            frames.append(frame)
        if len(frames) >= limit:
            break
    source.close()
    return frames


def test_a_fast_clip_gives_every_frame_once(clip: Path) -> None:
    """All frames, in order, at their media times."""
    frames = taken(open_source(SourceSettings(clip=clip, pace="fast")))
    assert [round(f.media_time_s * FPS) for f in frames] == list(range(FRAMES))
    brightness = [float(f.image.mean()) for f in frames]
    assert brightness == sorted(brightness)
    assert not any(f.cut for f in frames)


def test_a_loop_goes_on_in_time_and_marks_the_cut(clip: Path) -> None:
    """Media time never runs back, and the first frame of each round is a cut."""
    frames = taken(open_source(SourceSettings(clip=clip, loop=True, pace="fast")), 100)
    times = np.array([f.media_time_s for f in frames])
    assert np.allclose(np.diff(times), 1 / FPS, atol=2e-3)
    assert [i for i, f in enumerate(frames) if f.cut] == [45, 90]


def test_clips_are_played_in_turn(clip: Path, tmp_path: Path) -> None:
    """One after the other, some twice, then again from the first; each begins with a cut."""
    dark = tmp_path / "dark.mp4"
    writer = cv2.VideoWriter(str(dark), cv2.VideoWriter.fourcc(*"mp4v"), FPS, (320, 180))
    for _ in range(15):
        writer.write(np.zeros((180, 320, 3), dtype=np.uint8))
    writer.release()
    settings = SourceSettings(clip=(dark, clip, clip), loop=True, pace="fast")
    frames = taken(open_source(settings), 125)
    assert [i for i, f in enumerate(frames) if f.cut] == [15, 60, 105, 120]
    assert [i for i, f in enumerate(frames) if f.image.max() < 10] == [*range(15), *range(105, 120)]
    assert (np.diff([f.media_time_s for f in frames]) > 0).all()
    once = SourceSettings(clip=(dark, clip), pace="fast")
    assert len(taken(open_source(once))) == 15 + FRAMES
    with pytest.raises(InputError, match="nowhere"):
        open_source(SourceSettings(clip=(dark, tmp_path / "nowhere.mp4")))


@pytest.mark.long
@pytest.mark.slow
def test_real_time_plays_at_the_clips_own_speed(clip: Path) -> None:
    """1.5 s of video take 1.5 s, and a reader that keeps up loses nothing."""
    began = time.monotonic()
    source = open_source(SourceSettings(clip=clip))
    frames = taken(source)
    assert 1.4 < time.monotonic() - began < 10.0
    assert len(frames) + source.counters.skipped == FRAMES


@pytest.mark.parametrize(
    ("shape", "fps", "count", "room"),
    [((4, 4, 3), 40.0, 60, 41), ((4, 4, 3), 8.0, 15, 9), ((1080, 1920, 3), 40.0, 60, 20)],
)
def test_a_slow_reader_lags_by_a_few_frames_and_the_skipped_are_counted(
    shape: tuple[int, int, int], fps: float, count: int, room: int
) -> None:
    """Realtime over completeness: a second may wait, less of large ones; the oldest is skipped."""
    image = np.zeros(shape, np.uint8)
    offered = threading.Event()

    def capture(offer: Callable[[Frame], None], *_: object) -> None:
        for number in range(count):
            offer(Frame(image, float(number), 0, number / fps))
        offered.set()

    source = LiveSource(capture, "test")
    assert offered.wait(10)
    frames = [frame.media_time_s for frame in source.frames() if frame is not None]
    source.close()
    assert frames == [float(number) for number in range(count - room, count)]
    assert source.counters.skipped == count - room


CAMERA_FPS = 60


def read_at(
    rates_fps: Callable[[float], float], seconds: float
) -> tuple[np.ndarray, np.ndarray, int]:  # type: ignore[type-arg]
    """Frames of a 60 fps camera through a queue whose reader takes so many a second at a time.

    Returns:
        When each was taken and how old it was then, s, and how many were skipped.
    """
    image = np.zeros((4, 4, 3), np.uint8)
    offers: Queue[Callable[[Frame], None]] = Queue()

    def capture(offer: Callable[[Frame], None], stopping: threading.Event, _: object) -> None:
        offers.put(offer)
        stopping.wait(30)

    source = LiveSource(capture, "test")
    offer, frames = offers.get(timeout=60), source.frames()
    taken, free_s = [], 0.0
    for number in range(round(seconds * CAMERA_FPS)):
        now_s = number / CAMERA_FPS
        offer(Frame(image, now_s, 0, now_s))
        # What has been offered and neither taken nor skipped is waiting: none is waited for.
        while free_s < now_s + 1 / CAMERA_FPS and len(taken) + source.counters.skipped <= number:
            frame = next(frames)
            assert frame is not None
            at_s = max(free_s, now_s)
            taken.append((at_s, at_s - frame.captured_s))
            free_s = at_s + 1 / rates_fps(at_s)
    source.close()
    times_s, ages_s = np.array(taken).T
    return times_s, ages_s, source.counters.skipped


def test_a_reader_that_stays_too_slow_sees_what_is_new() -> None:
    """At two thirds of the camera's rate: all it can take, no old ones, none far apart."""
    times_s, ages_s, skipped = read_at(lambda _: 40.0, 20.0)
    assert ages_s.max() < 1.0
    assert ages_s[times_s > 5].max() < 0.15
    assert len(times_s) == pytest.approx(20 * 40, abs=2)
    assert skipped == pytest.approx(20 * 20, abs=10)  # some are still waiting at the end
    assert np.diff(times_s - ages_s).max() < 0.07


def test_a_burst_is_kept_and_so_is_the_next_after_an_overload() -> None:
    """A reader that stood for 0.9 s and is twice as fast as the camera misses nothing."""

    def rates_fps(at_s: float) -> float:
        stands = int(at_s) in {3, 23} and at_s % 1 < 0.02
        return 1 / 0.9 if stands else 30.0 if 6 < at_s < 10 else 120.0

    assert read_at(rates_fps, 6.0)[2] == 0
    assert read_at(rates_fps, 12.0)[2] == read_at(rates_fps, 28.0)[2] > 0


def test_a_reader_at_the_edge_of_what_it_can_take_stays_current() -> None:
    """Slow for 0.8 s of each 2.4 s, as beside other work: no queue grows between two skips."""
    times_s, ages_s, skipped = read_at(lambda at_s: 40.0 if at_s % 2.4 < 0.8 else 66.0, 60.0)
    assert ages_s[times_s > 25].max() < 0.15
    assert len(times_s) == pytest.approx(60 * 57.3, rel=0.02)
    assert skipped == pytest.approx(60 * 60 - len(times_s), abs=10)


def test_unreadable_clips_are_bad_input(tmp_path: Path, clip: Path) -> None:
    """Missing, empty, truncated, not a video: one line with the file's name."""
    truncated = tmp_path / "truncated.mp4"
    truncated.write_bytes(clip.read_bytes()[:-2000])
    text = tmp_path / "text.mp4"
    text.write_text("not a video")
    empty = tmp_path / "empty.mp4"
    empty.touch()
    for path in (truncated, text, empty, tmp_path / "missing.mp4", tmp_path):
        with pytest.raises(InputError, match=path.name) as caught:
            open_source(SourceSettings(clip=path))
        assert "\n" not in str(caught.value)


def test_a_clip_that_breaks_off_is_counted_and_goes_round(tmp_path: Path) -> None:
    """A stream that ends before its header says is noticed; the loop goes on."""
    path = tmp_path / "broken.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), FPS, (320, 180))
    noise = np.random.default_rng(1)
    for _ in range(FRAMES):
        writer.write(noise.integers(0, 255, (180, 320, 3), dtype=np.uint8))
    writer.release()
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    source = open_source(SourceSettings(clip=path, loop=True, pace="fast"))
    assert len(taken(source, 60)) == 60
    assert source.counters.decode_errors >= 1


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ({}, "either clip or url"),
        ({"clip": "a.mp4", "url": "rtsp://x"}, "either clip or url"),
        ({"url": "rtsp://x", "loop": True}, "for clips"),
        ({"url": "file:///etc/passwd"}, "url"),
        ({"clip": "a.mp4", "pace": "slow"}, "pace"),
    ],
)
def test_contradicting_settings_are_refused(data: dict[str, object], problem: str) -> None:
    """Exactly one source, and clip options only for clips."""
    with pytest.raises(InputError, match=problem):
        check(data, SourceSettings, "edge.toml")


@pytest.mark.slow
def test_an_absent_camera_is_waited_for_without_a_crash() -> None:
    """The reader hears None about once a second meanwhile."""
    source = open_camera("http://127.0.0.1:9/none", stall_timeout_s=1.0)
    began = time.monotonic()
    frames = source.frames()
    assert next(frames) is None
    assert time.monotonic() - began < 3
    source.close()


def test_a_capture_that_fails_does_not_look_like_the_end() -> None:
    """The reader gets the fault, so that the daemon ends with an error and is started again."""

    def capture(*_: object) -> None:
        raise OSError("the camera's driver is gone")

    with pytest.raises(OSError, match="driver"):
        list(LiveSource(capture, "test").frames())


def test_a_backlog_after_a_stall_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames that piled up come at once; their times of arrival would falsify every speed."""
    waits = [*[0.033] * 3, 0.8, *[0.001] * 10, *[0.033] * 3]
    now_s = 100.0

    class Stream:
        def read(self, _into: object) -> tuple[bool, object]:
            nonlocal now_s
            if not waits:
                time.sleep(0.05)
                return False, None
            now_s += waits.pop(0)
            return True, np.zeros((4, 4, 3), np.uint8)

        def get(self, _: int) -> float:
            return -(2.0**63)  # no time stamps

        def release(self) -> None:
            pass

    monkeypatch.setattr(cv2, "VideoCapture", lambda *_: Stream())
    clock = SimpleNamespace(monotonic=lambda: now_s, time_ns=time.time_ns)
    monkeypatch.setattr("edge_daemon.sources.camera.time", clock)
    source = open_camera("rtsp://camera", stall_timeout_s=1.0)
    frames = take(source.frames(), 7)
    source.close()
    assert [f.cut for f in frames] == [False, False, False, True, True, False, False]
    assert source.counters.skipped == 10


def test_passwords_do_not_reach_the_log() -> None:
    """Neither user, password nor query is shown."""
    assert without_password("rtsp://u:p@cam:554/s?token=1") == "rtsp://cam:554/s"


def test_going_back_to_the_start_sends_no_burst(
    clip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However long a looped clip takes to start again, its frames keep their distance after it."""
    reader = open_clip(clip, loop=True)
    read_all = reader.read_all

    now_s = 100.0
    sent: list[tuple[float, bool]] = []

    def slow_to_start_again() -> Iterator[ClipFrame]:
        nonlocal now_s
        for frame in read_all():
            if frame.cut:
                now_s += 0.4
            yield frame

    class Stopping(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            nonlocal now_s
            now_s += timeout or 0.0
            return any(cut for _, cut in sent[:-10])

    def run_here(capture: Capture, _name: str) -> None:
        capture(lambda frame: sent.append((now_s, frame.cut)), Stopping(), SourceCounters())

    monkeypatch.setattr(reader, "read_all", slow_to_start_again)
    clock = SimpleNamespace(monotonic=lambda: now_s, time_ns=time.time_ns)
    monkeypatch.setattr("edge_daemon.sources.clip.time", clock)
    monkeypatch.setattr("edge_daemon.sources.clip.LiveSource", run_here)
    paced_clip(reader)
    again = next(i for i, (_, cut) in enumerate(sent) if cut)
    gaps = np.diff([at_s for at_s, _ in sent[again:]])
    assert len(gaps) == 10
    assert gaps.min() > 0.9 / reader.fps

"""Live streams over real connections, their clocks, and clips that are not as they should be."""

from __future__ import annotations

import logging
import socket
import struct
import subprocess
import sys
import time
import wave
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge_daemon.frame import Frame
from edge_daemon.settings import SourceSettings
from edge_daemon.sources import FrameSource, open_source
from edge_daemon.sources.camera import open_camera
from edge_daemon.sources.clock import StreamClock
from edge_daemon.sources.diagnosis import diagnose
from slipstream.errors import InputError

from ..cameras import Feed, MjpegServer, Picture, RtspServer, take

SIZE = (320, 176)
PICTURE = np.random.default_rng(1).integers(0, 255, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
SMALLER = np.ascontiguousarray(PICTURE[:144, :256])


def a_feed() -> Feed:
    """Always the same picture, 25 times a second."""
    return Feed(lambda _: PICTURE)


def roughness_s(times_s: list[float], fps: float) -> float:
    """How far times lie from the nearest evenly spaced ones, root mean square."""
    number = np.round((np.array(times_s) - times_s[0]) * fps)
    left = np.array(times_s) - np.polyval(np.polyfit(number, times_s, 1), number)
    return float(np.sqrt(np.mean(left**2)))


@pytest.mark.long
def test_rtsp_frames_carry_the_streams_own_time() -> None:
    """ImagePool that arrive up to 30 ms late keep the even times at which they were taken."""
    feed = a_feed()
    feed.late_s = 0.03
    server = RtspServer(feed)
    source = open_camera(server.url, 5.0)
    # The first may come while the connection's backlog drains.
    frames = take(source.frames(), 50)[10:]
    source.close()
    server.close()
    arrived = roughness_s([f.captured_s for f in frames], 25)
    told = roughness_s([f.media_time_s for f in frames], 25)
    assert arrived > 0.003
    assert told < 0.0005
    assert not any(f.clock_jump for f in frames)


@pytest.mark.long
@pytest.mark.parametrize("serve", [RtspServer, MjpegServer])
def test_a_camera_that_stalls_or_restarts_is_found_again(
    serve: type[RtspServer | MjpegServer],
) -> None:
    """An open connection without pictures is given up; the next one begins with a cut."""
    feed = a_feed()
    server = serve(feed)
    source = open_camera(server.url, 1.0)
    frames = source.frames()
    before = take(frames, 3)
    feed.stalled = True
    while source.counters.reconnects == 0:
        next(frames)
    feed.stalled = False
    after = take(frames, 10)
    source.close()
    server.close()
    times = [f.media_time_s for f in before + after]
    assert times == sorted(times)
    assert any(f.cut for f in after)


@pytest.mark.long
def test_a_stream_that_changes_its_size_is_left_out_until_it_fits() -> None:
    """ImagePool of another size are counted and dated, never handed on."""
    feed = a_feed()
    server = RtspServer(feed)
    source = open_camera(server.url, 2.0, SIZE)
    frames = source.frames()
    take(frames, 3)
    feed.picture = lambda _: SMALLER
    deadline = time.monotonic() + 60
    while source.counters.size_mismatch_s is None and time.monotonic() < deadline:
        next(frames)
    assert source.counters.size_mismatch_s is not None
    assert source.counters.decode_errors > 0
    feed.picture = lambda _: PICTURE
    assert {f.image.shape for f in take(frames, 5)} == {PICTURE.shape}
    source.close()
    server.close()


def test_pictures_of_odd_size_are_read() -> None:
    """641×359 over HTTP."""
    odd = np.full((359, 641, 3), 99, dtype=np.uint8)
    server = MjpegServer(Feed(lambda _: odd))
    source = open_camera(server.url, 5.0, (641, 359))
    (frame,) = take(source.frames(), 1)
    source.close()
    server.close()
    assert frame.image.shape == odd.shape


@pytest.fixture
def silent() -> Iterator[int]:
    """The port of a server that accepts and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener.getsockname()[1]


@pytest.mark.slow
def test_why_there_is_no_picture_is_told(silent: int) -> None:
    """In a few words, by asking the server; passwords stay out of it."""
    server = MjpegServer(a_feed())
    said = {
        path: diagnose(server.address.replace("//", "//u:secret@") + path, 2.0)
        for path in ("/missing", "/page")
    }
    server.close()
    assert said == {
        "/missing": "the server says 404 Not Found",
        "/page": "the server sends text/html, but no picture that can be read",
    }
    assert diagnose(f"rtsp://127.0.0.1:{silent}/x", 0.2) == "the server does not answer"
    assert diagnose("http://127.0.0.1:9/x", 1.0) == "cannot connect: Connection refused"
    assert diagnose("rtsp://[::1", 1.0).startswith("cannot connect")


@pytest.mark.long
def test_a_silent_server_is_given_up_and_tried_again(
    silent: int, caplog: pytest.LogCaptureFixture
) -> None:
    """The reader hears None meanwhile, and the log says why."""
    caplog.set_level(logging.WARNING)
    source = open_camera(f"http://user:secret@127.0.0.1:{silent}/x", 0.3)
    frames = source.frames()
    deadline = time.monotonic() + 60
    while source.counters.reconnects < 2 and time.monotonic() < deadline:
        assert next(frames) is None
    source.close()
    assert source.counters.reconnects >= 2
    assert "the server does not answer" in caplog.text
    assert "secret" not in caplog.text


def told(clock: StreamClock, arrivals: list[float], stamps: list[float | None]) -> list[float]:
    """Media times of a row of pictures."""
    return [clock.media_time(a, s).time_s for a, s in zip(arrivals, stamps, strict=True)]


def test_small_jitter_of_arrival_is_smoothed_and_holes_are_kept() -> None:
    """Without time stamps: less than half of it is left; a lost second stays one second."""
    chance = np.random.default_rng(2)
    even = np.arange(400) / 25
    even[200:] += 1.0
    arrivals = even + chance.normal(0, 0.004, 400)
    times = np.array(told(StreamClock(), arrivals.tolist(), [None] * 400))
    assert np.all(np.diff(times) > 0)
    assert np.std((times - even)[50:200]) < 0.5 * np.std((arrivals - even)[50:200])
    assert np.abs(times - arrivals).max() < 0.5 / 25
    assert times[205] - times[195] == pytest.approx(1.4, abs=0.02)


def test_a_late_burst_keeps_the_streams_times() -> None:
    """A network that holds pictures back for a second changes nothing."""
    stamps = [n / 25 for n in range(200)]
    arrivals = [max(s, 4.0) if 3.0 < s < 4.0 else s for s in stamps]
    assert told(StreamClock(), arrivals, list(stamps)) == pytest.approx(stamps, abs=0.2)


def test_a_streams_clock_that_jumps_is_told_and_mended() -> None:
    """Back or an hour ahead: media time goes on with arrival."""
    for step in (-2.0, 3600.0):
        clock = StreamClock()
        jumps, times = [], []
        for n in range(100):
            now = clock.media_time(n / 25, n / 25 + (step if n >= 50 else 0.0))
            times.append(now.time_s)
            jumps.append(now.jumped)
            assert now.cut == now.jumped
        assert [n for n, jumped in enumerate(jumps) if jumped] == [50]
        assert times == pytest.approx([n / 25 for n in range(100)], abs=0.05)


def test_a_streams_clock_of_a_wrong_rate_is_not_used() -> None:
    """One that runs twice as fast would double every speed."""
    times = told(StreamClock(), [n / 25 for n in range(300)], [2 * n / 25 for n in range(300)])
    assert np.diff(times)[100:] == pytest.approx(1 / 25, abs=0.002)


def retimed(clip: bytes, entries: list[tuple[int, int]]) -> bytes:
    """The MP4 with another table of frame durations: (count, 1/15360 s) a row."""
    # Without its edit list, which would cut it at its old length.
    data = bytearray(clip.replace(b"edts", b"free"))
    at = data.index(b"stts") - 4
    table = struct.pack(">I4sII", 16 + 8 * len(entries), b"stts", 0, len(entries))
    table += b"".join(struct.pack(">II", *entry) for entry in entries)
    grown = len(table) - struct.unpack_from(">I", data, at)[0]
    for kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
        place = data.index(kind) - 4
        struct.pack_into(">I", data, place, struct.unpack_from(">I", data, place)[0] + grown)
    data[at : at + len(table) - grown] = table
    return bytes(data)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One second at 30 frames a second."""
    path = tmp_path_factory.mktemp("live") / "clip.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30, (320, 180))
    for number in range(30):
        writer.write(np.full((180, 320, 3), 20 + 5 * number, dtype=np.uint8))
    writer.release()
    return path


def played(path: Path) -> tuple[FrameSource, list[Frame]]:
    """All frames of a clip."""
    source = open_source(SourceSettings(clip=path, pace="fast"))
    return source, [frame for frame in source.frames() if frame is not None]


def test_a_variable_frame_rate_is_followed(clip: Path, tmp_path: Path) -> None:
    """Half of the clip at 30, half at 15 frames a second."""
    path = tmp_path / "vfr.mp4"
    path.write_bytes(retimed(clip.read_bytes(), [(15, 512), (15, 1024)]))
    _, frames = played(path)
    steps = np.diff([f.media_time_s for f in frames])
    assert steps[:14] == pytest.approx(1 / 30, abs=2e-3)
    assert steps[15:] == pytest.approx(1 / 15, abs=2e-3)


def test_a_clips_clock_that_leaps_is_mended_and_told(clip: Path, tmp_path: Path) -> None:
    """A gap of an hour is a cut, not an hour's wait."""
    path = tmp_path / "leap.mp4"
    path.write_bytes(retimed(clip.read_bytes(), [(14, 512), (1, 512 * 30 * 3600), (15, 512)]))
    _, frames = played(path)
    assert [n for n, f in enumerate(frames) if f.clock_jump] == [15]
    assert frames[15].cut
    assert frames[-1].media_time_s < 2.0


def test_pictures_of_a_clip_may_be_of_odd_size(tmp_path: Path) -> None:
    """A bare row of JPEGs runs at the rate that is given, from its first picture on."""
    picture: Picture = np.random.default_rng(0).integers(0, 255, (359, 641, 3), dtype=np.uint8)
    path = tmp_path / "odd.mjpeg"
    path.write_bytes(cv2.imencode(".jpg", picture)[1].tobytes() * 10)
    source = open_source(SourceSettings(clip=path, fps=20.0, pace="fast"))
    frames = [frame for frame in source.frames() if frame is not None]
    assert [f.image.shape for f in frames] == [picture.shape] * 10
    assert np.diff([f.media_time_s for f in frames]) == pytest.approx(1 / 20, abs=1e-3)


def lying(clip: Path, folder: Path) -> dict[str, Path]:
    """Files whose headers promise what is not there."""
    data = clip.read_bytes()
    media, header = data.index(b"mdat") - 4, data.index(b"moov") - 4
    huge = struct.pack(">I4sQ", 1, b"mdat", 5 << 30)
    samples = data.index(b"stsz") + 12
    made = {
        "four_gigabytes": data[:media] + struct.pack(">I", 2**32 - 1) + data[media + 4 :],
        "samples": data[:samples] + struct.pack(">I", 2**32 - 16) + data[samples + 4 :],
        "truncated": data[:-300],
        "headless": data[:header],
    }
    files = {}
    for name, content in made.items():
        files[name] = folder / f"{name}.mp4"
        files[name].write_bytes(content)
    files["sparse"] = folder / "sparse.mp4"
    with files["sparse"].open("wb") as file:
        file.write(data[:media] + huge)
        file.truncate(5 << 30)
    files["audio"] = folder / "audio.wav"
    with wave.open(str(files["audio"]), "wb") as sound:
        sound.setnchannels(1)
        sound.setsampwidth(2)
        sound.setframerate(8000)
        sound.writeframes(bytes(16000))
    files["no_frames"] = folder / "no_frames.mp4"
    cv2.VideoWriter(
        str(files["no_frames"]), cv2.VideoWriter.fourcc(*"mp4v"), 30, (320, 180)
    ).release()
    return files


def test_files_that_lie_are_one_line(clip: Path, tmp_path: Path) -> None:
    """Each is refused at once, whatever its header claims, with its name and a mend."""
    for name, path in lying(clip, tmp_path).items():
        began = time.monotonic()
        with pytest.raises(InputError, match=f"{name}.*not a readable video"):
            open_source(SourceSettings(clip=path))
        assert time.monotonic() - began < 5


@pytest.mark.process
def test_the_decoder_keeps_quiet(clip: Path, tmp_path: Path) -> None:
    """What the user reads is our line, not the decoder's remarks."""
    path = lying(clip, tmp_path)["truncated"]
    program = (
        "import sys, pathlib\n"
        "from edge_daemon.settings import SourceSettings\n"
        "from edge_daemon.sources import open_source\n"
        "from slipstream.errors import InputError\n"
        "try:\n"
        "    open_source(SourceSettings(clip=pathlib.Path(sys.argv[1])))\n"
        "except InputError as error:\n"
        "    print(error)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", program, str(path)],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert result.stdout.count("\n") == 1
    assert result.stderr == ""

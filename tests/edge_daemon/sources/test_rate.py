"""How fast a clip was filmed, where it ends and where it leaps: told, never guessed."""

from __future__ import annotations

import logging
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge_daemon.settings import SourceSettings
from edge_daemon.sources.clip import ClipReader, FastClip, open_clip
from edge_daemon.sources.clock import StreamClock
from edge_daemon.sources.h264 import h264_rate
from slipstream.config import check
from slipstream.errors import InputError

RAW_H264 = Path(__file__).parents[1] / "data" / "raw-30.h264"
"""45 pictures of a test card; its header states 30 frames a second."""
FRAMES, FPS = 60, 30


def _escaped(payload: bytes) -> bytes:
    """Without start codes in it: a 3 after two zero bytes, where one of 0 to 3 would follow."""
    made = bytearray()
    for byte in payload:
        if made[-2:] == b"\0\0" and byte <= 3:
            made.append(3)
        made.append(byte)
    return bytes(made)


def _bits(text: str) -> bytes:
    bits = text.replace(" ", "") + "1"
    bits += "0" * (-len(bits) % 8)
    return bytes(int(bits[i : i + 8], 2) for i in range(0, len(bits), 8))


def h264_header(timing: str) -> bytes:
    """A raw stream's head, of baseline profile and 64×48 px, up to its statement of a rate."""
    plain = f"{66:08b} {0:08b} {30:08b} 1 1 011 010 0 00100 011 1 1 0 {timing}"
    return b"\x00\x00\x00\x01\x67" + _escaped(_bits(plain)) + b"\x00\x00\x00\x01\x68\xce\x38\x80"


def timed(ticks: int, scale: int) -> str:
    """The bits that state a rate of scale / (2 ticks)."""
    return f"0 0 0 0 1 {ticks:032b} {scale:032b} 1 0 0 0 0"


def video(path: Path, code: str = "MJPG", frames: int = FRAMES) -> Path:
    """A video of noise at FPS."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), FPS, (160, 96))
    noise = np.random.default_rng(1)
    for _ in range(frames):
        writer.write(noise.integers(0, 255, (96, 160, 3), dtype=np.uint8))
    writer.release()
    return path


def row_of_jpegs(path: Path, between: bytes = b"") -> Path:
    """Ten pictures one after the other, as small cameras write them."""
    data = cv2.imencode(".jpg", np.full((96, 160, 3), 90, np.uint8))[1].tobytes()
    path.write_bytes((between + data) * 10 + between)
    return path


def avi_of_rate(path: Path, scale: int, rate: int, frame_us: int) -> Path:
    """An AVI whose headers say another rate."""
    data = bytearray(video(path).read_bytes())
    struct.pack_into("<I", data, data.index(b"avih") + 8, frame_us)
    struct.pack_into("<II", data, data.index(b"vids") + 20, scale, rate)
    path.write_bytes(data)
    return path


def played(reader: ClipReader) -> list[float]:
    """Media times of all frames."""
    return [frame.media_time_s for frame in FastClip(reader).frames()]


@pytest.mark.parametrize("kind", ["mjpeg", "multipart", "h264", "avi_0", "avi_1000", "avi_90000"])
def test_a_clip_that_does_not_say_its_rate_is_refused_until_it_is_given(
    tmp_path: Path, kind: str
) -> None:
    """FFmpeg's 25 frames a second are a guess, and a thousand are absurd: one line says so."""
    made = {
        "mjpeg": lambda: row_of_jpegs(tmp_path / "raw.mjpeg"),
        "multipart": lambda: row_of_jpegs(
            tmp_path / "cam.mpjpeg", b"\r\n--frame\r\nContent-type: image/jpeg\r\n\r\n"
        ),
        "h264": lambda: _without_rate(tmp_path / "RAW.H264"),
        "avi_0": lambda: avi_of_rate(tmp_path / "a.avi", 0, 0, 0),
        "avi_1000": lambda: avi_of_rate(tmp_path / "b.avi", 1, 1000, 1000),
        "avi_90000": lambda: avi_of_rate(tmp_path / "c.avi", 1, 90_000, 11),
    }
    path = made[kind]()
    with pytest.raises(InputError, match=r"fps.*--fps") as caught:
        open_clip(path, loop=False)
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)
    reader = open_clip(path, loop=False, fps=20.0)
    times = played(reader)
    assert reader.rate.source == "given"
    assert len(times) >= 10
    assert np.diff(times) == pytest.approx(1 / 20)


def _without_rate(path: Path) -> Path:
    """The test card with a rate of 90,000 frames a second in its header, as writers set it that
    know none.
    """
    data = RAW_H264.read_bytes()
    begin = data.index(b"\x00\x00\x01\x67") + 4
    end = data.index(b"\x00\x00\x01", begin)
    header = "".join(f"{byte:08b}" for byte in data[begin:end].replace(b"\0\0\3", b"\0\0"))
    stated = f"{1:032b}{60:032b}"
    assert header.count(stated) == 1
    header = header.replace(stated, f"{1:032b}{180_000:032b}")
    patched = bytes(int(header[i : i + 8], 2) for i in range(0, len(header), 8))
    path.write_bytes(data[:begin] + _escaped(patched) + data[end:])
    return path


def test_a_rate_in_the_streams_header_is_used_and_said(caplog: pytest.LogCaptureFixture) -> None:
    """Raw H.264 may state it: 30 frames a second here, where FFmpeg takes 25."""
    reader = open_clip(RAW_H264, loop=False)
    assert (reader.rate.fps, reader.rate.source) == (30.0, "stream header")
    assert np.diff(played(reader)) == pytest.approx(1 / 30)
    assert "30 frames a second" in caplog.text


@pytest.mark.parametrize(
    ("head", "fps"),
    [
        (h264_header("1 " + timed(1, 60)), 30.0),
        (h264_header("1 " + timed(1001, 60_000)), 60_000 / 2002),
        (h264_header("0"), None),
        (h264_header("1 0 0 0 0 0 0 0 0 0"), None),
        (h264_header("1 " + timed(1, 180_000)), None),
        (h264_header("1 " + timed(0, 60)), None),
        (h264_header("1 " + timed(1, 60))[:14], None),
        (b"\x00\x00\x00\x01\x40\x01\x0c\x01" * 9, None),
        (b"", None),
    ],
)
def test_the_header_of_h264_is_read(head: bytes, fps: float | None) -> None:
    """Two ticks a frame; none where it states no rate, an absurd one, or is cut off."""
    assert h264_rate(head) == fps


def test_a_given_rate_goes_first_and_a_contradiction_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Whoever gives it knows of a wrong header; whoever errs reads of it."""
    clip = video(tmp_path / "clip.mp4", "mp4v")
    assert np.diff(played(open_clip(clip, loop=False, fps=30.0))) == pytest.approx(1 / 30)
    assert not caplog.text
    assert np.diff(played(open_clip(clip, loop=False, fps=25.0))) == pytest.approx(1 / 25)
    assert "contradict the given 25 frames a second" in caplog.text
    caplog.clear()
    open_clip(RAW_H264, loop=False, fps=25.0)
    assert "says 30 frames a second, not the given 25" in caplog.text


def test_a_rate_is_for_clips() -> None:
    """A camera's frames have the times at which they come."""
    with pytest.raises(InputError, match="for clips"):
        check({"url": "http://cam/", "fps": 25.0}, SourceSettings, "edge.toml")
    with pytest.raises(InputError, match="fps"):
        check({"clip": "a.h264", "fps": 0.0}, SourceSettings, "edge.toml")


def test_capital_endings_are_the_same(tmp_path: Path) -> None:
    """Cameras name their files CLIP.MP4."""
    clip = video(tmp_path / "clip.mp4", "mp4v")
    capital = clip.rename(tmp_path / "CLIP.MP4")
    assert len(played(open_clip(capital, loop=False))) == FRAMES


def retimed(clip: bytes, entries: list[tuple[int, int]]) -> bytes:
    """The MP4 with another table of frame durations, (count, 1/15360 s) a row."""
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


class Capture:
    """What FFmpeg says of a clip at its end."""

    def __init__(self, frames: float, fps: float, last_pts: float) -> None:
        self._said = {
            cv2.CAP_PROP_FRAME_COUNT: frames,
            cv2.CAP_PROP_FPS: fps,
            cv2.CAP_PROP_PTS: last_pts,
        }

    def get(self, what: int) -> float:
        """One of its properties."""
        return self._said[what]


@pytest.mark.parametrize(
    ("read", "leap_s", "count", "begins", "is_whole"),
    [
        (480, 0.0, 480, 0, True),
        (480, 0.0, 15_480, 15_000, True),
        (480, 5.0, 630, 0, True),
        (480, 0.0, 480, 15_000, True),
        (300, 0.0, 480, 0, False),
        (300, 0.0, 15_480, 15_000, False),
        (300, 5.0, 630, 0, False),
        (300, 0.0, 480, 15_000, False),
        (480, 0.0, -(2**63), 0, True),
    ],
)
def test_only_frames_that_are_lost_are_told(
    read: int, leap_s: float, count: int, begins: int, is_whole: bool
) -> None:
    """A clip that starts late or leaps has fewer frames than its duration asks for: all are there.

    A truncated one has not, wherever it starts.
    """
    from edge_daemon.sources.clip import _is_whole
    from edge_daemon.sources.rate import Rate
    from edge_daemon.sources.timeline import Timeline

    times = Timeline(Rate(30.0, "time stamps", stamped=True), 0.0)
    for number in range(read):
        position_s = number / 30 + (leap_s if number > 200 else 0.0)
        times.next(position_s)
    capture = Capture(count, 30.0, begins + round(30 * position_s))
    assert _is_whole(capture, times) is is_whole  # type: ignore[arg-type]


def test_a_gap_in_a_clip_is_told_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Five seconds without a frame are no lost frames, and the times behind it are true."""
    path = tmp_path / "gap.mp4"
    whole = video(tmp_path / "clip.mp4", "mp4v").read_bytes()
    path.write_bytes(retimed(whole, [(29, 512), (1, 512 * 150), (30, 512)]))
    source = FastClip(open_clip(path, loop=False))
    times = [frame.media_time_s for frame in source.frames()]
    assert source.counters.gap_s == pytest.approx(5.0, abs=0.01)
    assert source.counters.decode_errors == 0
    assert times[30] - times[29] == pytest.approx(5.0, abs=0.01)
    assert "a gap of 5.0 s after 1.0 s" in caplog.text


def test_a_slow_camera_has_no_gaps(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A frame a second is a rate, too."""
    path = tmp_path / "slow.mp4"
    whole = video(tmp_path / "clip.mp4", "mp4v").read_bytes()
    path.write_bytes(retimed(whole, [(FRAMES, 15_360)]))
    source = FastClip(open_clip(path, loop=False))
    times = [frame.media_time_s for frame in source.frames()]
    assert np.diff(times) == pytest.approx(1.0, abs=0.01)
    assert source.counters.gap_s == 0
    assert not [r for r in caplog.records if r.levelno >= logging.WARNING]


def test_a_streams_clock_that_stands_still_is_none() -> None:
    """Raw H.264 by HTTP has the time stamp 0 on each frame: its frames come when they come."""
    clock = StreamClock()
    moments = [clock.media_time(n / 25, 0.0) for n in range(100)]
    assert not any(moment.jumped for moment in moments)
    assert [m.time_s for m in moments] == pytest.approx([n / 25 for n in range(100)], abs=0.01)


def test_a_streams_clock_that_stops_is_given_up() -> None:
    """One that ran and then repeats itself is a fault for a moment, not for good."""
    clock = StreamClock()
    moments = [clock.media_time(n / 25, min(n, 50) / 25) for n in range(200)]
    assert any(moment.jumped for moment in moments)
    assert not any(moment.jumped for moment in moments[60:])
    assert [m.time_s for m in moments] == pytest.approx([n / 25 for n in range(200)], abs=0.05)

"""How fast a video file was filmed, as its container or its stream says; nothing is guessed.

For a file without time stamps (raw H.264 or MJPEG, as small cameras write it) FFmpeg takes 25
frames a second, whatever they were filmed at.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Final, Literal

from edge_daemon.settings import MAX_FPS
from edge_daemon.sources.h264 import h264_rate
from slipstream.errors import InputError

_HEAD_BYTES: Final = 1 << 20
_STAMPED: Final = re.compile(
    rb"\x1aE\xdf\xa3|FLV\x01|OggS|DKIF|nut/|0&\xb2u\x8ef\xcf\x11|\x00\x00\x01\xba|....ftyp"
    rb"|RIFF....AVI |(?:\x47.{187}){3}|(?:.{4}\x47.{187}){3}",
    re.DOTALL,
)
"""Containers that may lack a duration, as of a recording that was cut off: Matroska, Flash, Ogg,
IVF, NUT, ASF, MPEG program stream, MP4, AVI, MPEG transport stream."""
_SAME_RATE: Final = 0.1

RateSource = Literal["time stamps", "stream header", "given"]


@dataclass(frozen=True)
class Rate:
    """The rate of a clip.

    Attributes:
        fps: frames a second; by time stamps: the usual one.
        source: who says so. Only by time stamps each frame has a time of its own.
        stamped: whether the container has time stamps, used or not.
        header_fps: what the header of a stream without time stamps says; None: nothing.
    """

    fps: float
    source: RateSource
    stamped: bool
    header_fps: float | None = None


def clip_rate(
    path: Path,
    positions_s: Sequence[float],
    nominal_fps: float,
    frame_count: float,
    given_fps: float | None,
) -> Rate:
    """The rate of a clip.

    Args:
        path: the file.
        positions_s: times of its first frames, as FFmpeg says them.
        nominal_fps: as FFmpeg says it.
        frame_count: as FFmpeg says it; not above 0 where the container has no duration.
        given_fps: what the user says, which goes before all else.

    Raises:
        InputError: nothing says it, or what does is absurd.
    """
    head = _head(path)
    measured = _measured_fps(positions_s)
    stamped = measured is not None and _has_stamps(head, frame_count)
    told = None if stamped else h264_rate(head)
    if given_fps is not None:
        return Rate(given_fps, "given", stamped, told)
    if len(positions_s) < 2:
        return Rate(1.0, "time stamps", stamped)
    if not stamped:
        if told is None:
            raise _not_told(path, "it has no time stamps, and nothing in it says its rate")
        return Rate(told, "stream header", stamped, told)
    assert measured is not None
    if measured > MAX_FPS:
        raise _not_told(path, f"its time stamps say {measured:.4g} frames a second")
    # Time stamps in whole milliseconds say 30.3 where the header says 30.
    near = abs(nominal_fps - measured) < _SAME_RATE * measured
    return Rate(nominal_fps if near else measured, "time stamps", stamped)


def _not_told(path: Path, problem: str) -> InputError:
    return InputError(
        path, problem, "give the rate that it was filmed at: --fps, or fps in [source]", key="fps"
    )


def _measured_fps(positions_s: Sequence[float]) -> float | None:
    """By the usual step between frames; None where they do not advance."""
    steps = [b - a for a, b in pairwise(positions_s)]
    usual_s = median(steps) if steps else 0.0
    return 1 / usual_s if usual_s > 0 else None


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "check the path") from None


def _has_stamps(head: bytes, frame_count: float) -> bool:
    if head.startswith(b"RIFF") and _avi_rate_is_missing(head):
        return False
    return frame_count > 0 or _STAMPED.match(head) is not None


def _avi_rate_is_missing(head: bytes) -> bool:
    """Whether an AVI says no rate, neither for its pictures nor for the whole: FFmpeg takes 25."""
    whole, stream = head.find(b"avih"), head.find(b"vids")
    if whole < 0 or stream < 0 or len(head) < stream + 28:
        return False
    (frame_us,) = struct.unpack_from("<I", head, whole + 8)
    scale, rate = struct.unpack_from("<II", head, stream + 20)
    return not (scale and rate) and not frame_us

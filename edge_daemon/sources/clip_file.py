"""One video file, opened: its first frame, its size and its rate."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from edge_daemon.frame import MAX_PIXELS, Image
from edge_daemon.sources.rate import Rate, clip_rate
from slipstream.errors import InputError
from slipstream.files import silent_libraries

log = logging.getLogger(__name__)

_PEEKED_FRAMES: Final = 12
_DIFFERS: Final = 0.02


@dataclass(frozen=True)
class Clip:
    """A video file, its capture, which stands at its first frame, and the rate at which it was
    filmed.
    """

    path: Path
    capture: cv2.VideoCapture
    rate: Rate


def open_file(
    path: Path, size: tuple[int, int] | None, fps: float | None
) -> tuple[Clip, tuple[int, int]]:
    """Open one: (it, its width and height); arguments and errors of
    `edge_daemon.sources.clip.open_clip`.
    """
    if not path.is_file():
        raise InputError(path, "no such video", "check the path")
    first, positions_s = _peek(path, _PEEKED_FRAMES)
    if first is None:
        raise InputError(
            path, "not a readable video (truncated, or no video stream)", "record or copy it again"
        )
    height, width = first.shape[:2]
    if size not in (None, (width, height)):
        raise InputError(
            path,
            f"its pictures are {width}×{height} px, the calibration is for {size[0]}×{size[1]}",
            "calibrate this camera",
        )
    # Opened again: going back to the start would lose the first frame of a file without an index.
    # Decoding overlaps with everything else as it is: more threads would only hold frames back.
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    rate = clip_rate(
        path,
        positions_s,
        capture.get(cv2.CAP_PROP_FPS),
        capture.get(cv2.CAP_PROP_FRAME_COUNT),
        fps,
    )
    if rate.header_fps is not None and abs(rate.header_fps - rate.fps) > _DIFFERS * rate.fps:
        log.warning(
            "%s: its stream's header says %g frames a second, not the given %g, which is used",
            path,
            rate.header_fps,
            rate.fps,
        )
    elif rate.header_fps is not None:
        log.warning("%s: no time stamps; its header says %g frames a second", path, rate.fps)
    return Clip(path, capture, rate), (width, height)


def first_frame(path: Path) -> Image | None:
    """The first readable frame of a video file; None where there is none, or a huge one."""
    return _peek(path, 1)[0]


def _peek(path: Path, frames: int) -> tuple[Image | None, list[float]]:
    """(first frame, times of so many frames as FFmpeg says them, s)."""
    positions_s: list[float] = []
    with silent_libraries():
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        try:
            pixels = capture.get(cv2.CAP_PROP_FRAME_WIDTH) * capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
            image = capture.read()[1] if capture.isOpened() and pixels <= MAX_PIXELS else None
            more = image is not None
            while more:
                positions_s.append(capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
                more = len(positions_s) < frames and capture.grab()
        except cv2.error:  # such as a frame that is not of the size that the file says
            return None, []
        finally:
            capture.release()
    return (None if image is None else np.asarray(image, dtype=np.uint8)), positions_s

"""Recorded clips: once or in a loop, in real time or every frame as fast as it goes."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from edge_daemon.frame import MAX_PIXELS, Frame, Image
from edge_daemon.sources.image_pool import ImagePool
from edge_daemon.sources.live import LiveSource, Offer
from edge_daemon.sources.protocol import SourceCounters
from slipstream.errors import InputError
from slipstream.files import silent_libraries
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

_MAX_FPS = 480.0
_LEAP_S = 10.0
_BACK_S = 0.5
_MAX_STEP_S = 1.0


@dataclass(frozen=True)
class ClipFrame:
    """One decoded frame: BGR, media time in s, and the flags of a `Frame`."""

    image: Image
    media_time_s: float
    cut: bool
    clock_jump: bool

    def now(self) -> Frame:
        """The frame as if it were taken at this moment."""
        return Frame(
            self.image,
            self.media_time_s,
            time.time_ns(),
            time.monotonic(),
            self.cut,
            self.clock_jump,
        )


class ClipReader:
    """Decodes a video file, with times that go on where a loop starts again."""

    def __init__(
        self, path: Path, capture: cv2.VideoCapture, shape: tuple[int, ...], *, loop: bool
    ) -> None:
        """Read from a capture that stands at its first frame.

        Args:
            path: the file.
            capture: opened on it.
            shape: (height, width, 3) of its frames; others are left out.
            loop: start again at its end.
        """
        self.path = path
        self._shape = shape
        self._capture = capture
        self._pool = ImagePool(shape)
        self._loop = loop
        fps = float(capture.get(cv2.CAP_PROP_FPS))
        self.fps = fps if 0 < fps <= _MAX_FPS else 30.0
        self._expected = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        self.counters = SourceCounters()
        self._limiter = LogLimiter()

    @property
    def expected_frames(self) -> int:
        """How many frames the file says it has; may be wrong."""
        return self._expected

    def read_all(self) -> Iterator[ClipFrame]:
        """All frames in order; ends with the clip unless it loops."""
        cut = False
        start, step = 0.0, min(1 / self.fps, _MAX_STEP_S)
        while True:
            shown, last, before = 0, start - step, 0.0
            while True:
                self.counters.tried_s = time.monotonic()
                ok, image = self._capture.read(self._pool.acquire())
                if not ok or image is None:
                    break
                position = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
                jumped = shown > 0 and not -_BACK_S < position - before < _LEAP_S
                before = position
                if jumped or (shown == 0 and position > _LEAP_S):
                    start = last + step - position
                # A stream without usable time stamps is taken to run at its nominal rate.
                at = start + position if start + position > last else last + step
                cut = cut or jumped or (shown == 0 and start > 0)
                if shown > 0:
                    step = min(at - last, _MAX_STEP_S)
                last = at
                shown += 1
                if image.shape != self._shape:
                    self._leave_out(image.shape)
                    continue
                yield ClipFrame(np.asarray(image, dtype=np.uint8), at, cut, jumped)
                cut = False
            if shown < 0.98 * self._expected:
                self.counters.decode_errors += 1
                if self._limiter.allow("short"):
                    log.warning(
                        "%s: %d of %d frames could be read; the rest is lost",
                        self.path,
                        shown,
                        self._expected,
                    )
            if not self._loop or shown == 0:
                return
            start = last + step
            self._capture.set(cv2.CAP_PROP_POS_FRAMES, 0)

    def _leave_out(self, shape: tuple[int, ...]) -> None:
        self.counters.decode_errors += 1
        self.counters.size_mismatch_s = time.monotonic()
        if self._limiter.allow("size"):
            log.warning(
                "%s: a picture of %d×%d amid others of %d×%d is left out",
                self.path,
                *shape[1::-1],
                *self._shape[1::-1],
            )

    def close(self) -> None:
        """Release the file."""
        self._capture.release()


def open_clip(path: Path, *, loop: bool, size: tuple[int, int] | None = None) -> ClipReader:
    """Open a video file.

    Args:
        path: the file.
        loop: start again at its end.
        size: (width, height) that it must have, px; None takes any.

    Raises:
        InputError: it is missing, no video, of another size, or its first frame is unreadable.
    """
    if not path.is_file():
        raise InputError(path, "no such video", "check the path")
    first = first_frame(path)
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
    return ClipReader(path, capture, first.shape, loop=loop)


def first_frame(path: Path) -> Image | None:
    """The first readable frame of a video file; None where there is none, or a huge one."""
    with silent_libraries():
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        try:
            pixels = capture.get(cv2.CAP_PROP_FRAME_WIDTH) * capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
            image = capture.read()[1] if capture.isOpened() and pixels <= MAX_PIXELS else None
        except cv2.error:  # such as a frame that is not of the size that the file says
            return None
        finally:
            capture.release()
    return None if image is None else np.asarray(image, dtype=np.uint8)


class FastClip:
    """Every frame of a clip, as fast as the reader takes them; nothing is skipped."""

    def __init__(self, reader: ClipReader) -> None:
        self._reader = reader
        self._closed = False
        self.counters = reader.counters

    def frames(self) -> Iterator[Frame]:
        """All frames in order."""
        for frame in self._reader.read_all():
            if self._closed:
                break
            yield frame.now()
        self._reader.close()

    def close(self) -> None:
        """End `frames` at the next one."""
        self._closed = True


def paced_clip(reader: ClipReader) -> LiveSource:
    """Play a clip at its own speed, as a camera would send it."""

    def capture(offer: Offer, stopping: threading.Event, counters: SourceCounters) -> None:
        reader.counters = counters
        began = time.monotonic()
        for frame in reader.read_all():
            ahead = began + frame.media_time_s - time.monotonic()
            if ahead < (0.0 if frame.cut else -1.0):
                # Going back to the start took a while, or the machine stood still: no camera sends
                # what it missed in a burst.
                began -= ahead
            if stopping.wait(max(0.0, ahead)):
                break
            offer(frame.now())
        reader.close()

    return LiveSource(capture, reader.path.name)

"""Recorded clips: once or in a loop, in real time or every frame as fast as it goes."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle
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
    """Decodes video files in turn, with times that go on where the next one or a loop begins."""

    def __init__(
        self,
        clips: Sequence[tuple[Path, cv2.VideoCapture]],
        shape: tuple[int, ...],
        *,
        loop: bool,
    ) -> None:
        """Read from captures that stand at their first frames.

        Args:
            clips: files, each with a capture that is opened on it; a file may be there twice.
            shape: (height, width, 3) of their frames; others are left out.
            loop: start again after the last one.
        """
        self._clips = clips
        self.path, capture = clips[0]
        self._shape = shape
        self._pool = ImagePool(shape)
        self._loop = loop
        fps = float(capture.get(cv2.CAP_PROP_FPS))
        self.fps = fps if 0 < fps <= _MAX_FPS else 30.0
        self._expected = int(sum(c.get(cv2.CAP_PROP_FRAME_COUNT) for _, c in clips))
        self.counters = SourceCounters()
        self._limiter = LogLimiter()

    @property
    def expected_frames(self) -> int:
        """How many frames the files say they have; may be wrong."""
        return self._expected

    def read_all(self) -> Iterator[ClipFrame]:
        """All frames in order; ends with the last clip unless they loop."""
        cut = False
        start, step = 0.0, min(1 / self.fps, _MAX_STEP_S)
        for path, capture in cycle(self._clips) if self._loop else self._clips:
            shown, last, before = 0, start - step, 0.0
            while True:
                self.counters.tried_s = time.monotonic()
                ok, image = capture.read(self._pool.acquire())
                if not ok or image is None:
                    break
                position = capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
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
            expected = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
            if shown < 0.98 * expected:
                self.counters.decode_errors += 1
                if self._limiter.allow("short"):
                    log.warning(
                        "%s: %d of %d frames could be read; the rest is lost",
                        path,
                        shown,
                        expected,
                    )
            if shown == 0:
                return
            start = last + step
            capture.set(cv2.CAP_PROP_POS_FRAMES, 0)

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
        """Release the files."""
        for _, capture in self._clips:
            capture.release()


def open_clip(*paths: Path, loop: bool, size: tuple[int, int] | None = None) -> ClipReader:
    """Open video files that are played in turn.

    Args:
        paths: the files, at least one.
        loop: start again after the last one.
        size: (width, height) that they must have, px; None takes that of the first one.

    Raises:
        InputError: one is missing, no video, of another size, or its first frame is unreadable.
    """
    captures: dict[Path, cv2.VideoCapture] = {}
    for path in paths:
        if path not in captures:
            captures[path], size = _open(path, size)
    assert size is not None
    return ClipReader([(path, captures[path]) for path in paths], (size[1], size[0], 3), loop=loop)


def _open(path: Path, size: tuple[int, int] | None) -> tuple[cv2.VideoCapture, tuple[int, int]]:
    """(capture that stands at its first frame, its width and height)."""
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
    return capture, (width, height)


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

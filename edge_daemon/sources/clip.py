"""Recorded clips: once or in a loop, in real time or every frame as fast as it goes."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from edge_daemon.frame import Frame, Image
from edge_daemon.sources.clip_file import Clip, open_file
from edge_daemon.sources.image_pool import ImagePool
from edge_daemon.sources.live import LiveSource, Offer
from edge_daemon.sources.protocol import SourceCounters
from edge_daemon.sources.timeline import Timeline
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

_MIN_SHOWN: Final = 0.98
_ROUNDING_STEPS: Final = 1.5


@dataclass(frozen=True)
class ClipFrame:
    """One decoded frame: BGR, media time in s, and the flags of a `Frame`."""

    image: Image
    media_time_s: float
    cut: bool
    clock_jump: bool
    left_out_s: float = 0.0

    def now(self) -> Frame:
        """The frame as if it were taken at this moment."""
        return Frame(
            self.image,
            self.media_time_s,
            time.time_ns(),
            time.monotonic(),
            self.cut,
            self.clock_jump,
            left_out_s=self.left_out_s,
        )


class ClipReader:
    """Decodes video files in turn, with times that go on where the next one or a loop begins; one
    may be there twice. Frames of another shape than (height, width, 3) are left out.
    """

    def __init__(self, clips: Sequence[Clip], shape: tuple[int, ...], *, loop: bool) -> None:
        self._clips = clips
        self.path, self.rate = clips[0].path, clips[0].rate
        self._shape = shape
        self._pool = ImagePool(shape)
        self._loop = loop
        counts = [clip.capture.get(cv2.CAP_PROP_FRAME_COUNT) for clip in clips]
        self._expected = int(sum(max(0.0, count) for count in counts))
        self.counters = SourceCounters()
        self._limiter = LogLimiter()

    @property
    def fps(self) -> float:
        """The rate of the first clip."""
        return self.rate.fps

    @property
    def expected_frames(self) -> int:
        """How many frames the files say they have; may be wrong."""
        return self._expected

    def read_all(self) -> Iterator[ClipFrame]:
        """All frames in order; ends with the last clip unless they loop."""
        times: Timeline | None = None
        cut = False
        for clip in cycle(self._clips) if self._loop else self._clips:
            begin_s, step_s = (0.0, None) if times is None else (times.next_s, times.step_s)
            cut = times is not None
            times = Timeline(clip.rate, begin_s, step_s)
            while True:
                self.counters.tried_s = time.monotonic()
                ok, image = clip.capture.read(self._pool.acquire())
                if not ok or image is None:
                    break
                before_s = times.next_s
                moment = times.next(clip.capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
                cut = cut or moment.jumped
                self._note_gap(clip, moment.gap_s, before_s - begin_s)
                if image.shape != self._shape:
                    self._leave_out(image.shape)
                    continue
                pixels = np.asarray(image, dtype=np.uint8)
                yield ClipFrame(pixels, moment.time_s, cut, moment.jumped, moment.left_out_s)
                cut = False
            self._note_end(clip, times)
            if times.frames == 0:
                return
            clip.capture.set(cv2.CAP_PROP_POS_FRAMES, 0)

    def _note_gap(self, clip: Clip, gap_s: float, after_s: float) -> None:
        if gap_s > 0:
            self.counters.gap_s += gap_s
            if self._limiter.allow(f"gap {clip.path}"):
                log.warning("%s: a gap of %.1f s after %.1f s of it", clip.path, gap_s, after_s)

    def _note_end(self, clip: Clip, times: Timeline) -> None:
        if times.differs and self._limiter.allow(f"differs {clip.path}"):
            log.warning(
                "%s: its time stamps contradict the given %g frames a second, which are used",
                clip.path,
                clip.rate.fps,
            )
        if not _is_whole(clip.capture, times):
            self.counters.decode_errors += 1
            if self._limiter.allow("short"):
                log.warning(
                    "%s: %d frames could be read, %.1f s, less than it says; the rest is lost",
                    clip.path,
                    times.frames,
                    times.shown_s,
                )

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
        for clip in self._clips:
            clip.capture.release()


def _is_whole(capture: cv2.VideoCapture, times: Timeline) -> bool:
    """Whether all frames were read that a clip's container says it has.

    Some containers know the number of frames, others the duration alone, which FFmpeg makes a
    number of; Matroska counts it from time 0, also where the first frame comes later.
    """
    expected = capture.get(cv2.CAP_PROP_FRAME_COUNT)
    nominal_fps = capture.get(cv2.CAP_PROP_FPS)
    if expected <= 0 or nominal_fps <= 0 or times.frames >= _MIN_SHOWN * expected:
        return True
    duration_s = expected / nominal_fps
    slack_s = (1 - _MIN_SHOWN) * times.shown_s + _ROUNDING_STEPS * times.step_s
    end_s = capture.get(cv2.CAP_PROP_PTS) / nominal_fps + times.step_s
    return times.shown_s >= duration_s - slack_s or abs(end_s - duration_s) <= slack_s


def open_clip(
    *paths: Path, loop: bool, size: tuple[int, int] | None = None, fps: float | None = None
) -> ClipReader:
    """Open video files that are played in turn, at least one.

    Args:
        paths: the files.
        loop: start again after the last one.
        size: (width, height) that they must have, px; None takes that of the first one.
        fps: frames a second that they were filmed at; None: as they say.

    Raises:
        InputError: one is missing, no video, of another size, or its first frame is unreadable; or
            it does not say its rate, and none is given.
    """
    clips: dict[Path, Clip] = {}
    for path in paths:
        if path not in clips:
            clips[path], size = open_file(path, size, fps)
    assert size is not None
    return ClipReader([clips[path] for path in paths], (size[1], size[0], 3), loop=loop)


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

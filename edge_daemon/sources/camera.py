"""A camera by URL (RTSP, HTTP MJPEG): own thread, own clock, reconnects with back-off."""

from __future__ import annotations

import logging
import threading
import time
from urllib.parse import urlsplit, urlunsplit

import cv2
import numpy as np

from edge_daemon.frame import Frame, Image
from edge_daemon.sources.backlog import Backlog
from edge_daemon.sources.clock import StreamClock
from edge_daemon.sources.diagnosis import diagnose
from edge_daemon.sources.image_pool import ImagePool
from edge_daemon.sources.live import LiveSource, Offer
from edge_daemon.sources.protocol import SourceCounters
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

_FIRST_WAIT_S = 0.5
_MAX_WAIT_S = 30.0
_ASK_S = 3.0
_NO_STAMP = -1e18


def without_password(url: str) -> str:
    """The URL as it may stand in a log."""
    parts = urlsplit(url)
    host = parts.netloc.rpartition("@")[2]
    return urlunsplit(parts._replace(netloc=host, query=""))


def open_camera(
    url: str, stall_timeout_s: float, size: tuple[int, int] | None = None
) -> LiveSource:
    """Watch a camera by its RTSP or HTTP address; it need not be there yet. It is connected again
    after `stall_timeout_s` without a frame; frames of another size than (width, height) are counted
    and left out.
    """
    shown = without_password(url)
    limiter = LogLimiter()

    def capture(offer: Offer, stopping: threading.Event, counters: SourceCounters) -> None:
        watched = _Camera(url, shown, stall_timeout_s, size, counters, limiter)
        wait_s = _FIRST_WAIT_S
        while not stopping.is_set():
            if watched.stream(offer, stopping):
                wait_s = _FIRST_WAIT_S
            if stopping.is_set():
                return
            counters.reconnects += 1
            if limiter.allow("lost"):
                why = diagnose(url, min(stall_timeout_s, _ASK_S))
                log.warning("%s: no picture (%s); trying again every 0.5 to 30 s", shown, why)
            stopping.wait(wait_s)
            wait_s = min(2 * wait_s, _MAX_WAIT_S)

    return LiveSource(capture, shown)


class _Camera:
    """What is known of a camera from one connection to the next."""

    def __init__(
        self,
        url: str,
        shown: str,
        stall_timeout_s: float,
        size: tuple[int, int] | None,
        counters: SourceCounters,
        limiter: LogLimiter,
    ) -> None:
        self._url = url
        self._shown = shown
        self._stall_ms = int(1e3 * stall_timeout_s)
        self._size = size
        self._pool = None if size is None else ImagePool((size[1], size[0], 3))
        self._counters = counters
        self._limiter = limiter
        self._began_s = time.monotonic()
        self._media_s = 0.0
        self._seen = False

    def stream(self, offer: Offer, stopping: threading.Event) -> bool:
        """Connect and offer frames until none comes; True if any did."""
        counters, pool = self._counters, self._pool
        counters.tried_s = time.monotonic()
        options = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, self._stall_ms]
        options += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, self._stall_ms]
        options += [cv2.CAP_PROP_N_THREADS, 1]  # more would hold back a frame each
        stream = cv2.VideoCapture(self._url, cv2.CAP_FFMPEG, options)
        clock, backlog = StreamClock(self._media_s), Backlog()
        cut = self._seen
        came = False
        while not stopping.is_set():
            ok, image = stream.read(None if pool is None else pool.acquire())
            if not ok or image is None:
                break
            came = True
            now = time.monotonic()
            counters.tried_s = now
            stamp_s = _stamp_s(stream)
            arrival = backlog.classify(now, stamp_s)
            if arrival.old:
                counters.skipped += 1
                continue
            cut = cut or (self._seen and arrival.cut)
            if not self._fits(np.asarray(image, dtype=np.uint8)):
                continue
            time_s, anew, jumped = clock.media_time(now - self._began_s, stamp_s)
            self._media_s = time_s
            offer(
                Frame(
                    np.asarray(image, dtype=np.uint8),
                    time_s,
                    time.time_ns(),
                    now,
                    cut or anew,
                    jumped,
                )
            )
            cut, self._seen = False, True
        stream.release()
        return came

    def _fits(self, image: Image) -> bool:
        height, width = image.shape[:2]
        if self._size in (None, (width, height)):
            return True
        # A camera that fell back to another stream may return to the calibrated one.
        self._counters.decode_errors += 1
        self._counters.size_mismatch_s = time.monotonic()
        if self._limiter.allow("size"):
            log.warning(
                "%s: pictures of %d×%d do not fit the calibration", self._shown, width, height
            )
        return False


def _stamp_s(stream: cv2.VideoCapture) -> float | None:
    """The stream's own time of the last frame; None where its container carries none."""
    if stream.get(cv2.CAP_PROP_PTS) < _NO_STAMP:
        return None
    return stream.get(cv2.CAP_PROP_POS_MSEC) / 1e3

"""A camera by URL (RTSP, HTTP MJPEG): own thread, own clock, reconnects with back-off."""

from __future__ import annotations

import logging
import threading
import time
from urllib.parse import urlsplit, urlunsplit

import cv2

from edge_daemon.frame import Frame
from edge_daemon.sources.live import LiveSource, Offer
from edge_daemon.sources.protocol import SourceCounters
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

_FIRST_WAIT_S = 0.5
_LONGEST_WAIT_S = 30.0
_BACKLOG_S = 0.004
_HOLE_S = 0.5


def without_password(url: str) -> str:
    """The URL as it may stand in a log."""
    parts = urlsplit(url)
    host = parts.netloc.rpartition("@")[2]
    return urlunsplit(parts._replace(netloc=host, query=""))


def open_camera(url: str, stall_s: float) -> LiveSource:
    """Watch a camera; it need not be there yet.

    Args:
        url: RTSP or HTTP address.
        stall_s: reconnect after so many seconds without a frame.
    """
    shown = without_password(url)
    limiter = LogLimiter()

    def capture(offer: Offer, stopping: threading.Event, counters: SourceCounters) -> None:
        wait_s = _FIRST_WAIT_S
        began = last = time.monotonic()
        connected_before = False
        while not stopping.is_set():
            counters.tried_s = time.monotonic()
            stream = cv2.VideoCapture(
                url,
                cv2.CAP_FFMPEG,
                [
                    cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
                    int(1e3 * stall_s),
                    cv2.CAP_PROP_READ_TIMEOUT_MSEC,
                    int(1e3 * stall_s),
                ],
            )
            cut = connected_before
            while not stopping.is_set():
                ok, image = stream.read()
                if not ok or image is None:
                    break
                now = time.monotonic()
                since, last = now - last, now
                counters.tried_s = now
                if since < _BACKLOG_S:
                    # What piled up during a stall comes at once: its times are not its own.
                    counters.skipped += 1
                    continue
                cut = cut or (connected_before and since > _HOLE_S)
                offer(Frame(image, now - began, time.time_ns(), now, cut))  # type: ignore[arg-type]
                cut, connected_before, wait_s = False, True, _FIRST_WAIT_S
            stream.release()
            if stopping.is_set():
                return
            counters.reconnects += 1
            if limiter.allow("lost"):
                log.warning("%s: no picture; trying again every %.1f to 30 s", shown, wait_s)
            stopping.wait(wait_s)
            wait_s = min(2 * wait_s, _LONGEST_WAIT_S)

    return LiveSource(capture, shown)

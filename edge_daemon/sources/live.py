"""A source with a capture thread: the queue is bounded, and skipped frames are counted."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

from edge_daemon.frame import Frame
from edge_daemon.sources.protocol import SourceCounters

log = logging.getLogger(__name__)

MAX_WAIT_S: Final = 1.0

MAX_WAITING_BYTES: Final = 128_000_000
"""46 frames of 720p, 20 of 1080p."""

Offer = Callable[[Frame], None]
Capture = Callable[[Offer, threading.Event, SourceCounters], None]


class LiveSource:
    """Runs a capture function in a thread and queues its frames.

    Frames may wait up to a second for a reader that was busy for a moment, then the oldest is
    skipped. So a reader who is slower than the camera lags behind it by that second at most.
    """

    def __init__(self, capture: Capture, name: str) -> None:
        """Start capturing.

        Args:
            capture: called as ``capture(offer, stopping, counters)``; the source ends when it
                returns.
            name: for the log.
        """
        self.counters = SourceCounters()
        self._changed = threading.Condition()
        self._waiting: deque[Frame] = deque()
        self._ended = False
        self._fault: Exception | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(capture, name), name=f"capture {name}", daemon=True
        )
        self._thread.start()

    def _run(self, capture: Capture, name: str) -> None:
        try:
            capture(self._offer, self._stopping, self.counters)
        except Exception as fault:
            log.error("capture of %s failed: %s", name, fault)
            self._fault = fault
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify()

    def _offer(self, frame: Frame) -> None:
        with self._changed:
            self._waiting.append(frame)
            # One at a time, so that a tracker has gaps of one frame rather than of many.
            while len(self._waiting) > 1 and self._is_too_much(frame):
                lost = self._waiting.popleft()
                following = self._waiting[0]
                self._waiting[0] = replace(
                    following,
                    cut=following.cut or lost.cut,
                    clock_jump=following.clock_jump or lost.clock_jump,
                )
                self.counters.skipped += 1
            self._changed.notify()

    def _is_too_much(self, newest: Frame) -> bool:
        waits_s = newest.captured_s - self._waiting[0].captured_s
        held = len(self._waiting) * newest.image.nbytes
        return waits_s > MAX_WAIT_S or held > MAX_WAITING_BYTES

    def frames(self) -> Iterator[Frame | None]:
        """Frames as they come; None once a second while there is none.

        Raises:
            Exception: what ended the capture, if it was a fault.
        """
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._ended, timeout=1.0)
                frame = self._waiting.popleft() if self._waiting else None
                if frame is None and (self._ended or self._stopping.is_set()):
                    if self._fault is not None:
                        raise self._fault
                    return
            yield frame

    def close(self) -> None:
        """Stop the capture thread; `frames` ends."""
        self._stopping.set()
        self._thread.join(timeout=5.0)

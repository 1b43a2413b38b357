"""A source with a capture thread: the queue is bounded, and skipped frames are counted."""

from __future__ import annotations

import logging
import math
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

from edge_daemon.frame import Frame
from edge_daemon.sources.protocol import SourceCounters

log = logging.getLogger(__name__)

MAX_WAIT_S: Final = 1.0
MAX_STANDING_S: Final = 0.15
"""A backlog above it that lasts is no burst: the reader is slower than the camera."""
_LASTS_S: Final = 2.0
"""A reader twice as fast as the camera is through with a whole second by then."""
_OVERLOADED_WAIT_S: Final = 0.12
_RECOVERED_S: Final = 10.0
"""A reader at the edge of what it can take goes without a skip for a second or two."""

MAX_WAITING_BYTES: Final = 128_000_000
"""46 frames of 720p, 20 of 1080p."""

Offer = Callable[[Frame], None]
Capture = Callable[[Offer, threading.Event, SourceCounters], None]


class LiveSource:
    """Runs ``capture(offer, stopping, counters)`` in a thread and queues its frames, until it
    returns.

    Frames may wait up to a second for a reader that was busy for a moment, then the oldest is
    skipped. For a reader that stays slower than the camera they wait `_OVERLOADED_WAIT_S`.
    """

    def __init__(self, capture: Capture, name: str) -> None:
        self.counters = SourceCounters()
        self._changed = threading.Condition()
        self._waiting: deque[Frame] = deque()
        self._limit = _WaitLimit()
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
            self._limit.update(frame.captured_s, self._waits_s(frame))
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
                self._limit.skipped_s = frame.captured_s
            self._changed.notify()

    def _waits_s(self, newest: Frame) -> float:
        return newest.captured_s - self._waiting[0].captured_s

    def _is_too_much(self, newest: Frame) -> bool:
        held = len(self._waiting) * newest.image.nbytes
        return self._waits_s(newest) > self._limit.seconds or held > MAX_WAITING_BYTES

    def frames(self) -> Iterator[Frame | None]:
        """Frames as they come; None once a second while there is none. A fault of the capture ends
        them.
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


class _WaitLimit:
    """How long frames may wait, by whether the reader keeps up with the camera.

    A backlog that stands is told from a burst by its duration, as in CoDel (RFC 8289). The limit
    then falls by a second a second, so that the frames left out while the backlog goes are spread
    over it, and returns to `MAX_WAIT_S` after `_RECOVERED_S` in which none was left out.
    """

    def __init__(self) -> None:
        self.seconds = MAX_WAIT_S
        self.skipped_s = -math.inf
        self._standing_since_s = math.inf
        self._last_s = math.inf
        self._overloaded = False

    def update(self, now_s: float, waits_s: float) -> None:
        """Note a new frame's time, and how long the oldest has waited by then."""
        passed_s, self._last_s = max(0.0, now_s - self._last_s), now_s
        if waits_s <= MAX_STANDING_S:
            self._standing_since_s = math.inf
        else:
            self._standing_since_s = min(self._standing_since_s, now_s)
        if self._overloaded:
            self.seconds = max(_OVERLOADED_WAIT_S, self.seconds - passed_s)
            if now_s - self.skipped_s > _RECOVERED_S:
                self._overloaded, self.seconds = False, MAX_WAIT_S
        elif now_s - self._standing_since_s > _LASTS_S:
            self._overloaded, self.seconds, self.skipped_s = True, waits_s, now_s

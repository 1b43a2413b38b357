"""Frames through a detector while the next ones are decoded and the last ones are tracked."""

from __future__ import annotations

import threading
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from queue import Full, Queue
from typing import TypeVar

from edge_daemon.detection.protocol import Detections, Detector
from edge_daemon.frame import Frame

T = TypeVar("T")

_JOIN_S = 5.0
_LOOK_S = 0.1


@dataclass(frozen=True)
class _End:
    """What ended a source: its fault, or None."""

    fault: BaseException | None


def detect_stream(
    frames: Iterable[Frame | None], detector: Detector, depth: int | None = None
) -> Generator[tuple[Frame | None, Detections | None]]:
    """Detect in each frame, as many at a time as the detector has requests, and hand them on in
    order, each exactly once; a repeated frame, and the source's None (nothing has come), without
    detections.

    A frame is taken from the source only when a request is free for it, so that a live source knows
    how far behind its reader is, and handed on as soon as its vehicles are known, whether or not
    another frame has come. Close the generator to stop early; it then waits for the source's next
    answer. What the source or the detector raises comes at that frame's place.
    """
    count = detector.requests if depth is None else depth
    if count < 1:
        raise ValueError("depth is at least 1")
    free = threading.Semaphore(count)
    stopping = threading.Event()
    # A result that waits for the caller holds no request: one may wait beside those in flight.
    found: Queue[tuple[Frame | None, Future[Detections] | None] | _End] = Queue(count + 1)

    def detect(frame: Frame) -> Detections:
        try:
            return detector.detect(frame.image)
        finally:
            free.release()

    def feed() -> None:
        fault: BaseException | None = None
        try:
            source = iter(frames)
            while True:
                free.acquire()
                if stopping.is_set():
                    break
                try:
                    frame = next(source)
                except StopIteration:
                    break
                if stopping.is_set():
                    break
                if frame is None or frame.repeated:
                    free.release()
                    _put(found, (frame, None), stopping)
                else:
                    _put(found, (frame, pool.submit(detect, frame)), stopping)
            _close(source)
        except BaseException as caught:
            fault = caught
        _put(found, _End(fault), stopping)

    with ThreadPoolExecutor(count, thread_name_prefix="detect") as pool:
        feeder = threading.Thread(target=feed, name="frames", daemon=True)
        feeder.start()
        try:
            while True:
                item = found.get()
                if isinstance(item, _End):
                    if item.fault is not None:
                        raise item.fault
                    return
                frame, pending = item
                yield frame, None if pending is None else pending.result()
        finally:
            stopping.set()
            free.release()
            feeder.join(_JOIN_S)
            pool.shutdown(wait=True, cancel_futures=True)


def prefetch(items: Iterable[T], count: int) -> Generator[T]:
    """The same items in the same order, up to `count` of them made ahead in a thread; what `items`
    raises comes at its place.
    """
    ready: Queue[tuple[T] | _End] = Queue(count)
    stopping = threading.Event()

    def make() -> None:
        fault: BaseException | None = None
        try:
            source = iter(items)
            for item in source:
                _put(ready, (item,), stopping)
                if stopping.is_set():
                    break
            _close(source)
        except BaseException as caught:
            fault = caught
        _put(ready, _End(fault), stopping)

    maker = threading.Thread(target=make, name="prefetch", daemon=True)
    maker.start()
    try:
        while True:
            item = ready.get()
            if isinstance(item, _End):
                if item.fault is not None:
                    raise item.fault
                return
            yield item[0]
    finally:
        stopping.set()
        maker.join(_JOIN_S)


def _put(queue: Queue[T], item: T, stopping: threading.Event) -> None:
    """Wait for a place in the queue, but not for a reader who has gone."""
    while not stopping.is_set():
        try:
            queue.put(item, timeout=_LOOK_S)
        except Full:
            continue
        return


def _close(source: Iterator[object]) -> None:
    """Close a generator in the thread that ran it."""
    if isinstance(source, Generator):
        source.close()

"""Frames through a detector, several at a time."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from queue import Queue

import numpy as np
import pytest

from edge_daemon.detection import Detections, detect_stream, prefetch
from edge_daemon.frame import Frame, Image


def frame(number: int) -> Frame:
    """A frame whose only pixel tells its number."""
    return Frame(np.full((1, 1, 3), number, dtype=np.uint8), number / 30, 0, time.monotonic())


class Numbered:
    """Answers with as many boxes as the picture says; records how many pictures it had at once."""

    def __init__(self, requests: int = 2, seconds: float = 0.0) -> None:
        self.requests = requests
        self.most = 0
        self._seconds = seconds
        self._inside = 0
        self._lock = threading.Lock()

    def detect(self, image: Image) -> Detections:
        with self._lock:
            self._inside += 1
            self.most = max(self.most, self._inside)
        number = int(image[0, 0, 0])
        # Every other picture takes longer, so that answers come out of order.
        time.sleep(self._seconds * (1 + number % 2))
        with self._lock:
            self._inside -= 1
        if number == 99:
            raise RuntimeError("no answer")
        return Detections(
            np.zeros((number, 4), np.float32), np.ones(number, np.float32), np.zeros(number, int)
        )


def test_a_repeated_frame_is_handed_on_without_detections() -> None:
    """In its place, and without a request of the detector's."""
    frames = [replace(frame(n), repeated=n % 2 == 1) for n in range(1, 9)]
    detector = Numbered(requests=1)
    results = list(detect_stream(iter(frames), detector))
    assert [f for f, _ in results] == frames
    assert [None if d is None else len(d.scores) for _, d in results] == [
        None if n % 2 else n for n in range(1, 9)
    ]


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_each_frame_once_and_in_order(depth: int) -> None:
    """Whatever takes how long, results stand beside their own frame; None stays where it was."""
    offered = [frame(n) if n % 5 else None for n in range(40)]
    detector = Numbered(depth, 0.002)
    got = list(detect_stream(offered, detector))
    assert [f for f, _ in got] == offered
    assert [None if d is None else len(d) for _, d in got] == [
        n if n % 5 else None for n in range(40)
    ]
    assert detector.most == depth


def test_a_live_frame_does_not_wait_for_the_next() -> None:
    """The result is there as soon as it is known, though the source has nothing more."""
    source: Queue[Frame | None] = Queue()
    stream = detect_stream(iter(source.get, None), Numbered())
    for number in range(3):
        source.put(frame(number))
        before = time.monotonic()
        got, found = next(stream)
        assert got is not None
        assert found is not None
        assert len(found) == number
        assert time.monotonic() - before < 10
    source.put(None)
    assert list(stream) == []


def test_no_frame_is_taken_before_a_request_is_free() -> None:
    """A busy detector leaves the newest frame with the source."""
    taken: list[int] = []
    go = threading.Event()

    class Waiting(Numbered):
        def detect(self, image: Image) -> Detections:
            assert go.wait(30)
            return super().detect(image)

    def source() -> Iterator[Frame]:
        for number in range(6):
            taken.append(number)
            yield frame(number)

    stream = detect_stream(source(), Waiting(2))
    results: list[object] = []
    reader = threading.Thread(target=lambda: results.extend(stream))
    reader.start()
    deadline = time.monotonic() + 60
    while len(taken) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.1)
    assert taken == [0, 1]
    go.set()
    reader.join(30)
    assert len(results) == 6


@pytest.mark.parametrize("where", ["detector", "source"])
def test_faults_are_raised_where_they_belong(where: str) -> None:
    """What came before a fault is handed on first; then the caller gets the fault."""

    def source() -> Iterator[Frame]:
        yield frame(1)
        yield frame(2)
        if where == "source":
            raise RuntimeError("no answer")
        yield frame(99)
        yield frame(3)

    stream = detect_stream(source(), Numbered())
    assert [len(found) for _, found in (next(stream), next(stream)) if found is not None] == [1, 2]
    with pytest.raises(RuntimeError, match="no answer"):
        next(stream)
    assert list(stream) == []


def test_closing_early_ends_the_threads_and_the_source() -> None:
    """Nothing goes on in the background, and the source's own clean-up has run."""
    closed = threading.Event()

    def source() -> Iterator[Frame]:
        try:
            while True:
                yield frame(1)
        finally:
            closed.set()

    before = set(threading.enumerate())
    stream = detect_stream(source(), Numbered())
    next(stream)
    stream.close()
    assert closed.wait(2)
    assert set(threading.enumerate()) <= before
    items = prefetch(iter(source()), 2)
    next(items)
    items.close()
    assert set(threading.enumerate()) <= before


def test_items_made_ahead_keep_order_and_number() -> None:
    """No more than the bound is made ahead, and a fault comes after what was made before it."""
    made: list[int] = []

    def numbers() -> Iterator[int]:
        for number in range(10):
            made.append(number)
            yield number
        raise ValueError("enough")

    items = prefetch(numbers(), 3)
    assert next(items) == 0
    time.sleep(0.1)
    assert len(made) <= 5
    assert [next(items) for _ in range(9)] == list(range(1, 10))
    with pytest.raises(ValueError, match="enough"):
        next(items)

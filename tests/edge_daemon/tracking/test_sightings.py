"""What is remembered of the frames' sightings."""

from __future__ import annotations

import numpy as np

from edge_daemon.tracking import Sightings
from edge_daemon.tracking.sightings import SightingBuffer


def frame(*times_s: float) -> Sightings:
    """A frame's sightings at these media times."""
    n = len(times_s)
    return Sightings(
        np.arange(n),
        np.array(times_s),
        np.zeros((n, 2)),
        np.zeros((n, 2, 2)),
        np.zeros((n, 2)),
        np.zeros(n, dtype=np.int64),
        np.zeros((n, 4), dtype=np.float32),
    )


def times(memory: SightingBuffer) -> list[float]:
    """Media times of all that is remembered."""
    everything = memory.all()
    return [] if everything is None else [float(time) for time in everything.time_s]


def test_asking_changes_nothing() -> None:
    """Asked after each frame or only at the end, the same is remembered: whole frames."""
    asked, unasked = SightingBuffer(), SightingBuffer()
    for now in range(12):
        # A track just confirmed brings what was seen of it before.
        sightings = frame(now - 2.0, now - 1.0, now) if now % 3 else frame()
        for memory in (asked, unasked):
            memory.add(sightings)
            memory.drop(now - 4.0)
        times(asked)
    assert (
        times(asked)
        == times(unasked)
        == [5.0, 6.0, 7.0, 6.0, 7.0, 8.0, 8.0, 9.0, 10.0, 9.0, 10.0, 11.0]
    )


def test_nothing_is_left_of_what_is_all_forgotten() -> None:
    """Neither of frames that were asked for nor of those after them."""
    memory = SightingBuffer()
    memory.add(frame(1.0, 1.0))
    assert times(memory) == [1.0, 1.0]
    memory.add(frame(2.0))
    memory.drop(3.0)
    assert memory.all() is None
    memory.add(frame(4.0))
    assert times(memory) == [4.0]

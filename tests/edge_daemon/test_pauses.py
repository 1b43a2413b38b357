"""What took long, told when frames are skipped; and freed memory handed back."""

from __future__ import annotations

import gc
import time

import numpy as np
import pytest

from edge_daemon import heap
from edge_daemon.heap import give_back_freed
from edge_daemon.pauses import Pauses
from slipstream.service import rss_mb


def test_the_longest_of_each_part_is_told_once_and_longest_first() -> None:
    """In milliseconds; what was told is forgotten."""
    pauses = Pauses()
    pauses.note("states", 0.012)
    pauses.note("preview", 0.2)
    pauses.note("states", 0.003)
    assert pauses.told() == "preview 200 ms, states 12 ms"
    assert pauses.told() == ""


def test_a_part_is_timed_also_if_it_fails() -> None:
    """A fault must not hide what took long before it."""
    pauses = Pauses()

    def fail() -> None:
        with pauses.of("states"):
            time.sleep(0.02)
            raise ValueError("x")

    with pytest.raises(ValueError, match="x"):
        fail()
    part, took, _ = pauses.told().rsplit(" ", 2)
    assert part == "states"
    assert int(took) >= 20


def test_collections_are_noticed_while_asked_for() -> None:
    """And no longer: the hook is taken away."""
    pauses, before = Pauses(), list(gc.callbacks)
    with pauses.of_garbage_collector():
        gc.collect()
    assert "garbage collection" in pauses.told()
    gc.collect()
    assert pauses.told() == ""
    assert gc.callbacks == before


@pytest.mark.skipif(heap._TRIM is None, reason="this C library has nothing to give back")
def test_freed_memory_that_the_heap_kept_goes_back() -> None:
    """40 MB in pieces too small for pages of their own, every thousandth of them kept."""
    pieces = [np.ones(1000) for _ in range(5_000)]
    kept = pieces[::1000]
    full = rss_mb()
    del pieces
    give_back_freed()
    assert rss_mb() < full - 20
    assert len(kept) == 5

"""Stages that take long are reported, and freed memory is returned to the system."""

from __future__ import annotations

import gc
import sys
import time

import numpy as np
import pytest

from edge_daemon import runtime
from edge_daemon.runtime import StageTimer, trim_memory
from slipstream.service import rss_mb


def test_the_longest_of_each_part_is_told_once_and_longest_first() -> None:
    """In milliseconds; what was told is forgotten."""
    stages = StageTimer()
    stages.note("states", 0.012)
    stages.note("preview", 0.2)
    stages.note("states", 0.003)
    assert stages.report() == "preview 200 ms, states 12 ms"
    assert stages.report() == ""


def test_a_part_is_timed_also_if_it_fails() -> None:
    """A fault must not hide what took long before it."""
    stages = StageTimer()

    def fail() -> None:
        with stages.measure("states"):
            time.sleep(0.02)
            raise ValueError("x")

    with pytest.raises(ValueError, match="x"):
        fail()
    part, took, _ = stages.report().rsplit(" ", 2)
    assert part == "states"
    assert int(took) >= 20


@pytest.mark.slow
def test_collections_are_noticed_while_asked_for() -> None:
    """And no longer: the hook is taken away."""
    stages, before = StageTimer(), list(gc.callbacks)
    with stages.measure_garbage_collection():
        gc.collect()
    assert "garbage collection" in stages.report()
    gc.collect()
    assert stages.report() == ""
    assert gc.callbacks == before


@pytest.mark.skipif(runtime._TRIM is None, reason="this C library has nothing to give back")
def test_freed_memory_that_the_heap_kept_goes_back() -> None:
    """40 MB in pieces too small for pages of their own, every thousandth of them kept."""
    pieces = [np.ones(1000) for _ in range(5_000)]
    kept = pieces[::1000]
    full = rss_mb()
    del pieces
    trim_memory()
    assert rss_mb() < full - 20
    assert len(kept) == 5


def test_what_was_freed_is_given_back_by_python_too() -> None:
    """Freed tuples wait for their like in lists of thousands, which nothing else empties."""
    gc.collect()
    gc.disable()
    try:
        before = sys.getallocatedblocks()
        tuples = [(object(),) * length for length in range(1, 20) for _ in range(2000)]
        del tuples
        trim_memory()
        assert sys.getallocatedblocks() - before < 2000
    finally:
        gc.enable()

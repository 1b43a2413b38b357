"""Freed memory is returned to the system."""

from __future__ import annotations

import gc
import sys

import numpy as np
import pytest

from slipstream.config import ServiceSettings
from slipstream.service import Service, memory, rss_mb, service
from slipstream.service.memory import trim_memory


@pytest.mark.skipif(memory._TRIM is None, reason="this C library has nothing to give back")
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


def test_progress_gives_memory_back_twice_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    """However often it is told."""
    now_s, trimmed = 1000.0, []
    monkeypatch.setattr(service.time, "monotonic", lambda: now_s)
    monkeypatch.setattr(service, "trim_memory", lambda: trimmed.append(now_s))
    daemon = Service("any", ServiceSettings())
    for _ in range(90):
        daemon.progress()
        now_s += 1.0
    assert trimmed == [1030.0, 1060.0]

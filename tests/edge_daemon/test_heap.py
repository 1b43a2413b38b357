"""What the interpreter keeps of freed memory."""

from __future__ import annotations

import gc
import sys

from edge_daemon.heap import give_back_freed


def test_what_was_freed_is_given_back_by_python_too() -> None:
    """Freed tuples wait for their like in lists of thousands, which nothing else empties."""
    gc.collect()
    gc.disable()
    try:
        before = sys.getallocatedblocks()
        tuples = [(object(),) * length for length in range(1, 20) for _ in range(2000)]
        del tuples
        give_back_freed()
        assert sys.getallocatedblocks() - before < 2000
    finally:
        gc.enable()

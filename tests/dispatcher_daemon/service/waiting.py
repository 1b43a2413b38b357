"""Tests wait for conditions, never for a time."""

from __future__ import annotations

import time
from collections.abc import Callable


def wait_for(condition: Callable[[], bool], within_s: float = 120.0) -> bool:
    """Poll until it is true; whether it became so."""
    ends = time.monotonic() + within_s
    while not (met := condition()) and time.monotonic() < ends:
        time.sleep(0.02)
    return met

"""UTC that nobody sets while the process runs."""

from __future__ import annotations

import time
from collections.abc import Callable


class SteadyClock:
    """The wall clock's time at the start, and what has passed since by the monotonic clock.

    A wall clock that is set would make jobs older, or free a budget, by as much.

    Args:
        wall_ns: UTC, read once.
        monotonic_ns: what has passed.
    """

    def __init__(
        self,
        wall_ns: Callable[[], int] = time.time_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._monotonic_ns = monotonic_ns
        self._offset_ns = wall_ns() - monotonic_ns()

    def __call__(self) -> int:
        """UTC, ns."""
        return self._offset_ns + self._monotonic_ns()

"""Where platoons may form, by what the RSUs say on the bus: as the dispatcher judges it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from slipstream import freshness
from slipstream.errors import InputError
from slipstream.messages import SegmentState, decode


class BusGates:
    """Latest states of segments; written by the bus's thread, read by the simulation's.

    A vehicle knows no truth: what its RSU calls turbulent is turbulent to it, and what nobody
    calls stable is closed.
    """

    def __init__(self, clock_ns: Callable[[], int] = time.time_ns) -> None:
        self._clock_ns = clock_ns
        self._lock = threading.Lock()
        self._states: dict[tuple[str, str], SegmentState] = {}

    def take(self, key: str, payload: bytes) -> None:
        """A message from `ALL_STATES`; what is no state is left out."""
        try:
            state = decode(SegmentState, payload, key)
        except InputError:
            return
        with self._lock:
            self._states[state.segment, state.rsu] = state

    def is_open(self, segment: str) -> bool:
        """Whether a fresh state calls it stable, and none turbulent."""
        return self._flag(segment) == 1

    def is_turbulent(self, segment: str) -> bool:
        """Whether a fresh state calls it turbulent."""
        return self._flag(segment) == 0

    def _flag(self, segment: str) -> int | None:
        with self._lock:
            states = [state for (name, _), state in self._states.items() if name == segment]
        decisive = freshness.decisive(
            states, self._clock_ns(), stale_after_s=freshness.STALE_AFTER_S
        )
        if decisive is None or decisive.fault is not None:
            return None
        return decisive.state.y_e

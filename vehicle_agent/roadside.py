"""What RSUs have told of the segments ahead: where close gaps are allowed."""

from __future__ import annotations

from typing import Final

from slipstream import freshness
from slipstream.messages import SegmentState

_FORGET_EVERY_NS: Final = 60 * 10**9


class Roadside:
    """Latest states of segments, judged as the dispatcher judges them.

    A vehicle knows no truth: what its RSU calls turbulent is turbulent to it, and what nobody calls
    stable is closed.
    """

    def __init__(self, stale_after_s: float = freshness.STALE_AFTER_S) -> None:
        self._stale_after_s = stale_after_s
        self._states: dict[str, dict[str, SegmentState]] = {}
        self._now_ns = self._forgot_ns = 0
        self._judged: dict[str, int | None] = {}

    def receive(self, state: SegmentState) -> None:
        """Take in a state; one that is older than the known one of its RSU is left out."""
        known = self._states.setdefault(state.segment, {})
        before = known.get(state.rsu)
        if before is None or before.time_ns <= state.time_ns:
            known[state.rsu] = state
            self._judged.pop(state.segment, None)

    def at(self, now_ns: int) -> None:
        """Judge by this time from now on, UTC."""
        if now_ns != self._now_ns:
            self._now_ns = now_ns
            self._judged.clear()
        if now_ns - self._forgot_ns >= _FORGET_EVERY_NS:
            self._forgot_ns = now_ns
            self._forget()

    def is_open(self, segment: str) -> bool:
        """Whether a fresh state calls it stable, and none turbulent."""
        return self._flag(segment) == 1

    def is_turbulent(self, segment: str) -> bool:
        """Whether a fresh state calls it turbulent."""
        return self._flag(segment) == 0

    def _forget(self) -> None:
        """Forget states that are too old, which count for nothing: those of roads left behind."""
        for segment, known in list(self._states.items()):
            for rsu, state in list(known.items()):
                if freshness.age_s(state.time_ns, self._now_ns) > self._stale_after_s:
                    del known[rsu]
            if not known:
                del self._states[segment]

    def _flag(self, segment: str) -> int | None:
        states = self._states.get(segment)
        if states is None:
            return None
        if segment not in self._judged:
            decisive = freshness.decisive(
                states.values(), self._now_ns, stale_after_s=self._stale_after_s
            )
            fresh = decisive is not None and decisive.fault is None
            self._judged[segment] = decisive.state.y_e if decisive is not None and fresh else None
        return self._judged[segment]


CLOSED: Final = Roadside()
"""Gates of an agent that trusts nothing: close gaps are allowed nowhere."""

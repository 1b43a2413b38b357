"""How often callers may ask."""

from __future__ import annotations

from typing import Final

MAX_CALLERS: Final = 10_000
"""Callers that are told apart; beyond, all begin anew."""


class RateLimit:
    """A token bucket for each caller.

    Args:
        rate_per_s: requests of one caller that are allowed for long, 1/s.
        burst: that are allowed at once.
    """

    def __init__(self, rate_per_s: float, burst: float) -> None:
        self.rate_per_s, self._burst = rate_per_s, burst
        self._left: dict[str, tuple[float, float]] = {}

    def wait_s(self, caller: str, now_s: float) -> float:
        """Take one request; time until the next one is allowed, 0 if this one is, s."""
        if caller not in self._left and len(self._left) >= MAX_CALLERS:
            self._left.clear()
        left, then_s = self._left.get(caller, (self._burst, now_s))
        left = min(self._burst, left + (now_s - then_s) * self.rate_per_s)
        allowed = left >= 1.0
        self._left[caller] = (left - 1.0 if allowed else left), now_s
        return 0.0 if allowed else (1.0 - left) / self.rate_per_s

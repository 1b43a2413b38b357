"""Debouncing: evidence must last before a fault begins, and be absent before it ends."""

from __future__ import annotations


class Debounce:
    """Turns momentary evidence into a fault: `after_s` of it without a break begin it, `clear_s`
    without any end it.
    """

    def __init__(self, after_s: float, clear_s: float) -> None:
        self._after_s = after_s
        self._clear_s = clear_s
        self._since_s: float | None = None
        self._last_s = 0.0
        self.active = False

    def update(self, now_s: float, seen: bool) -> bool:
        """Take in what was seen at a media time; True while the fault lasts."""
        if seen:
            if self._since_s is None:
                self._since_s = now_s
            self._last_s = now_s
            self.active = self.active or now_s - self._since_s >= self._after_s
        else:
            self._since_s = None
            self.active = self.active and now_s - self._last_s < self._clear_s
        return self.active

    def restart(self) -> None:
        """Drop evidence that has not yet become a fault: the time line or the scene was cut."""
        self._since_s = None

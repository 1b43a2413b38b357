"""One line of progress on a terminal; silent in a pipe."""

from __future__ import annotations

import time
from typing import Final, Self, TextIO

_TOO_EARLY_S: Final = 5.0
"""Before that a rate says little."""


class ProgressLine:
    """Progress of long work in percent, and how long the rest will take at the same rate; on
    terminals only.
    """

    def __init__(self, label: str, stream: TextIO) -> None:
        self._label = label
        self._stream = stream
        self._percent = -1
        self._began_s = time.monotonic()

    def update(self, done: int, total: int) -> None:
        """Report that ``done`` of ``total`` steps are done; nothing is shown without a total."""
        if total <= 0:
            return
        percent = min(100, 100 * done // total)
        if self._stream.isatty() and percent != self._percent:
            self._percent = percent
            left = self._left(done, total)
            self._stream.write(f"\r{self._label} {percent:3d} %{left:<16}")
            self._stream.flush()

    def _left(self, done: int, total: int) -> str:
        """In words; nothing until it can be told."""
        passed_s = time.monotonic() - self._began_s
        if done <= 0 or passed_s < _TOO_EARLY_S:
            return ""
        left_s = passed_s * (total - done) / done
        return f", {left_s / 60:.0f} min left" if left_s >= 60 else f", {left_s:.0f} s left"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._percent >= 0:
            self._stream.write("\n")

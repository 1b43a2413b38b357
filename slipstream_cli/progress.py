"""One line of progress on a terminal; silent in a pipe."""

from __future__ import annotations

from typing import Self, TextIO


class Progress:
    """Progress of long work in percent, on terminals only."""

    def __init__(self, label: str, stream: TextIO) -> None:
        self._label = label
        self._stream = stream
        self._percent = -1

    def update(self, done: int, total: int) -> None:
        """Report that ``done`` of ``total`` steps are done."""
        percent = 100 * done // max(total, 1)
        if self._stream.isatty() and percent != self._percent:
            self._percent = percent
            self._stream.write(f"\r{self._label} {percent:3d} %")
            self._stream.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._percent >= 0:
            self._stream.write("\n")

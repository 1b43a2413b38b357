"""The error for bad input, with its one-line message."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Final

MAX_FAULTS: Final = 20
"""Of one file that are told."""
_MAX_LENGTH: Final = 600


class InputError(Exception):
    """Bad input from outside: a file, an option, a setting, a port, a message.

    The command line prints it as one line and exits with status 2.

    Args:
        source: the file, option or address that holds the fault.
        problem: what is wrong with it.
        mend: what the user can do about it.
        key: the key, column or line inside the source; None where it has no such parts.

    Attributes:
        others: further faults that were found with this one.
    """

    def __init__(
        self, source: str | Path, problem: str, mend: str, *, key: str | None = None
    ) -> None:
        self.source = str(source)
        self.key = key
        self.problem = problem
        self.mend = mend
        self.others: tuple[InputError, ...] = ()
        super().__init__(str(self))

    def __str__(self) -> str:
        where = f"{self.source}: {_short(self.key)}" if self.key else self.source
        line = " ".join(f"{where}: {_short(self.problem)}; {self.mend}".split())
        # What a file holds must not steer the terminal that shows its fault.
        return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return (_rebuild, (self.source, self.problem, self.mend, self.key))


def refuse(faults: Iterable[InputError]) -> None:
    """Raise the first fault, with at most `MAX_FAULTS` in all; nothing without one.

    Raises:
        InputError: the first of them; its `others` are the further ones.
    """
    found = [*islice(faults, MAX_FAULTS)]
    if found:
        found[0].others = tuple(found[1:])
        raise found[0]


def _short(text: str) -> str:
    """What a file holds, where it would fill a screen."""
    return text if len(text) <= _MAX_LENGTH else f"{text[: _MAX_LENGTH - 3]}..."


def _rebuild(source: str, problem: str, mend: str, key: str | None) -> InputError:
    return InputError(source, problem, mend, key=key)

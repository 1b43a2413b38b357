"""What HiGHS reads and solves, with what it warns of."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import highspy

from dispatcher_daemon.forms.milp import QuietHighs

_PREFIX: Final = re.compile(r"(WARNING|ERROR):\s*(.*)")
_PLACE: Final = re.compile(r"--> .*:(\d+):\d+$")
_MAX_WARNINGS: Final = 20


class TellingHighs(QuietHighs):
    """HiGHS without output, whose warnings and errors can be asked for.

    It logs to a file: its callback for messages raises an error in C++ where a message is no UTF-8,
    as those about a faulty MPS file may be.
    """

    @contextmanager
    def told(self) -> Iterator[list[str]]:
        """The warnings and errors of what is done meanwhile, each once; known at the end."""
        solver: Any = self
        found: list[str] = []
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "log"
            for option, value in (
                ("log_to_console", False),
                ("log_file", str(log)),
                ("output_flag", True),
            ):
                solver.setOptionValue(option, value)
            try:
                yield found
            finally:
                solver.setOptionValue("output_flag", False)
                solver.setOptionValue("log_file", "")
            lines = log.read_bytes().decode("utf-8", "replace").splitlines()
        found += dict.fromkeys(_messages(lines))


def _messages(lines: list[str]) -> Iterator[str]:
    for number, line in enumerate(lines):
        message = _PREFIX.match(line)
        if message is not None:
            place = _PLACE.search(lines[number + 1]) if number + 1 < len(lines) else None
            at = "" if place is None else f"line {place[1]}: "
            yield at + " ".join(message[2].split())


def read_linear(text: str, ending: str) -> tuple[TellingHighs, bool, tuple[str, ...]]:
    """HiGHS with a model of an LP or MPS file, whether it could be read, what is odd about it."""
    solver: Any = TellingHighs()
    with tempfile.TemporaryDirectory() as folder, solver.told() as found:
        copy = Path(folder) / f"model{ending}"
        copy.write_text(text, encoding="utf-8", newline="\n")
        read = solver.readModel(str(copy)) != highspy.HighsStatus.kError
    if not read:
        return solver, False, tuple(found)
    if ending == ".mps":
        found += _taken_from_mps(text, solver.getLp())
    found += _contradictions(solver.getLp())
    more = len(found) - _MAX_WARNINGS
    return solver, True, (*found[:_MAX_WARNINGS], *([f"and {more} more"] if more > 0 else []))


def _contradictions(lp: Any) -> Iterator[str]:
    """Bounds that exclude each other: a cause of infeasibility that the file shows by itself."""
    for names, lower, upper, letter in (
        (lp.col_names_, lp.col_lower_, lp.col_upper_, "x"),
        (lp.row_names_, lp.row_lower_, lp.row_upper_, "row "),
    ):
        for i, (least, most) in enumerate(zip(lower, upper, strict=True)):
            if least > most:
                name = names[i] if i < len(names) else f"{letter}{i}"
                yield f"{name} has inconsistent bounds: from {least:g} to {most:g}"


def _taken_from_mps(text: str, lp: Any) -> Iterator[str]:
    """What MPS leaves open: the objective of several free rows, bounds of integers."""
    sections: dict[str, list[list[str]]] = {}
    rows: list[list[str]] = []
    for line in text.splitlines():
        words = line.split()
        if words and line[0] not in "* \t":
            rows = sections.setdefault(words[0].upper(), [])
        elif words and line[0] != "*":
            rows.append(words)
    free = [words[1] for words in sections.get("ROWS", []) if words[0].upper() == "N" and words[1:]]
    if len(free) > 1:
        yield f"of {len(free)} free rows the first, {free[0]}, is the objective"
    bounded = {word for words in sections.get("BOUNDS", []) for word in words[1:]}
    whole = highspy.HighsVarType.kInteger
    unbounded = [
        name
        for name, kind, least, most in zip(
            lp.col_names_, lp.integrality_, lp.col_lower_, lp.col_upper_, strict=False
        )
        if kind == whole and (least, most) == (0.0, 1.0) and name not in bounded
    ]
    if unbounded:
        named = ", ".join(unbounded[:3]) + (", ..." if unbounded[3:] else "")
        yield f"integers without bounds are taken as 0 or 1, as is usual in MPS: {named}"

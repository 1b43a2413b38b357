"""QUBOs written as lists of coordinates, ``i j value`` a line: each format has its own convention
for what such a line means.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal

import dimod

from slipstream.errors import InputError
from slipstream_lab.research.models.qubo import QuboFile, qubo_of

Vartype = Literal["BINARY", "SPIN"]
_MAX_VARIABLES: Final = 1_000_000
_Entry = tuple[int, int, int, float]
"""Line, i, j, value."""


def qs_qubo(text: str, path: Path) -> QuboFile:
    """ZIMPL's ``.qs``: minimised, a symmetric matrix of which one half is stored, so an entry
    beside the diagonal counts twice; the offset in a comment.
    """
    bqm = _symmetric(text, path)
    for number, words in _lines(text):
        if words[0] == "#" and len(words) == 3 and words[1] == "ObjectiveOffset":
            bqm.offset = _number(words[2], path, number)
    return qubo_of(bqm)


def biq_qubo(text: str, path: Path) -> QuboFile:
    """The Biq Mac library's ``.sparse`` and McSparse's ``.bq``: x'Qx is minimised, Q being
    symmetric, so an entry beside the diagonal counts twice. OR-Library's files are maximised and
    begin with the number of problems: they are refused.
    """
    return qubo_of(_symmetric(text, path))


def max_cut(text: str, path: Path) -> QuboFile:
    """A graph as rudy writes it: the weight of the edges between the vertices of 1 and those of 0
    is maximised.
    """
    size, entries = _counted(text, path)
    bqm = _with_variables(size)
    for number, i, j, weight in entries:
        if i == j:
            raise _faulty(path, number, "an edge from a vertex to itself")
        bqm.add_linear(str(i), weight)
        bqm.add_linear(str(j), weight)
        bqm.add_quadratic(str(i), str(j), -2 * weight)
    return qubo_of(bqm, maximise=True)


def qbsolv_qubo(text: str, path: Path) -> QuboFile:
    """qbsolv's ``.qubo``: minimised, variables from 0 on, each entry counts once, i < j."""
    bqm: Any = dimod.BinaryQuadraticModel("BINARY")
    size, left, seen = None, [0, 0], set[tuple[int, int]]()
    for number, words in _lines(text):
        if words[0][0] == "c":
            continue
        if words[0] == "p":
            if len(words) != 6 or words[1].lower() != "qubo" or size is not None:
                raise _faulty(path, number, "not 'p qubo topology maxNodes nNodes nCouplers'")
            size, *left = (_index(word, path, number) for word in words[3:])
            continue
        if size is None:
            raise _faulty(path, number, "no line 'p qubo ...' before: not qbsolv's format")
        i, j, value = _entry(words, path, number)
        if not 0 <= i <= j < size:
            raise _faulty(path, number, f"a pair that is not i <= j < {size}")
        if (i, j) in seen:
            raise _faulty(path, number, f"entry {i} {j} twice")
        seen.add((i, j))
        if i == j:
            bqm.add_linear(i, value)
        else:
            bqm.add_quadratic(i, j, value)
        left[i != j] -= 1
    for what, missing in zip(("nodes", "couplers"), left, strict=True):
        if missing:
            problem = f"{abs(missing)} {what} {'fewer' if missing > 0 else 'more'} than stated"
            raise InputError(path, problem, "give the whole file")
    return qubo_of(bqm)


def coo_qubo(text: str, path: Path, vartype: Vartype | None = None) -> QuboFile:
    """dimod's coordinates: minimised, each entry counts once; a comment says ``vartype=`` and
    perhaps ``offset=``.
    """
    offset, found = 0.0, list[tuple[int, int, float]]()
    own: str | None = None
    for number, words in _lines(text):
        if not words[0].startswith("#"):
            found.append(_entry(words, path, number))
            continue
        line = " ".join(words)
        kind = re.search(r"vartype *[:=] *(\w+)", line, re.IGNORECASE)
        if kind is not None:
            if kind[1].upper() not in ("BINARY", "SPIN"):
                raise _faulty(path, number, f"variables of type {kind[1]}")
            if own not in (None, kind[1].upper()):
                raise _faulty(path, number, f"variables of type {kind[1]}, and {own} before")
            own = kind[1].upper()
        stated = re.search(r"offset *[:=] *(\S+)", line, re.IGNORECASE)
        if stated is not None:
            offset = _number(stated[1], path, number)
    if own is None and vartype is None:
        mend = "give --vartype BINARY (0 or 1) or SPIN (-1 or 1), or write '# vartype=SPIN'"
        raise InputError(path, "does not say whether its variables are bits or spins", mend)
    if None not in (own, vartype) and own != vartype:
        problem = f"{path} says its variables are {own}"
        raise InputError("--vartype", problem, "leave it out")
    bqm: Any = dimod.BinaryQuadraticModel(own or vartype)
    bqm.offset = offset
    for i, j, value in found:
        if i == j:
            bqm.add_linear(i, value)
        else:
            bqm.add_quadratic(i, j, value)
    return qubo_of(bqm)


def _symmetric(text: str, path: Path) -> Any:
    """x'Qx of a stored half of Q."""
    size, entries = _counted(text, path)
    bqm = _with_variables(size)
    for _, i, j, value in entries:
        if i == j:
            bqm.add_linear(str(i), value)
        else:
            bqm.add_quadratic(str(i), str(j), 2 * value)
    return bqm


def _with_variables(size: int) -> Any:
    bqm: Any = dimod.BinaryQuadraticModel("BINARY")
    for i in range(1, size + 1):
        bqm.add_variable(str(i))
    return bqm


def _counted(text: str, path: Path) -> tuple[int, list[_Entry]]:
    """A line with the numbers of variables and entries, then these; variables are 1 and up."""
    size: int | None = None
    stated, seen = 0, set[tuple[int, int]]()
    entries: list[_Entry] = []
    for number, words in _lines(text):
        if words[0].startswith("#"):
            continue
        if size is None:
            if len(words) == 1:
                problem = "one number: several problems, as in OR-Library, where they are maximised"
                raise _faulty(path, number, problem)
            if len(words) != 2:
                raise _faulty(path, number, "not 'variables entries'")
            size, stated = (_index(word, path, number) for word in words)
            if size > _MAX_VARIABLES:
                raise _faulty(path, number, f"{size} variables")
            continue
        i, j, value = _entry(words, path, number)
        if len(entries) == stated:
            raise _faulty(path, number, "more entries than stated")
        if not (1 <= i <= size and 1 <= j <= size):
            raise _faulty(path, number, f"a variable that is not from 1 to {size}")
        if (min(i, j), max(i, j)) in seen:
            raise _faulty(path, number, f"entry {i} {j} twice, one half of the matrix is enough")
        seen.add((min(i, j), max(i, j)))
        entries.append((number, i, j, value))
    if size is None or len(entries) < stated:
        missing = stated - len(entries)
        raise InputError(path, f"cut off: {missing} entries are missing", "give the whole file")
    return size, entries


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    for number, line in enumerate(text.split("\n"), 1):
        words = line.split()
        if words:
            yield number, words


def _entry(words: list[str], path: Path, line: int) -> tuple[int, int, float]:
    if len(words) != 3:
        raise _faulty(path, line, "not 'i j value'")
    i, j = (_index(word, path, line) for word in words[:2])
    return i, j, _number(words[2], path, line)


def _index(word: str, path: Path, line: int) -> int:
    if not re.fullmatch(r"[0-9]{1,9}", word):
        raise _faulty(path, line, f"{word!r} is not a whole number from 0 on")
    return int(word)


def _number(word: str, path: Path, line: int) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _faulty(path, line, f"{word!r} is not a number")
    return value


def _faulty(path: Path, line: int, problem: str) -> InputError:
    return InputError(path, problem, "mend it", key=f"line {line}")

"""Models from files: LP and MPS by HiGHS, QUBOs as ``.qs``, ``.coo``, dimod's ``.json``, ``.bqm``.

Each may be packed by xz or gzip.
"""

from __future__ import annotations

import io
import json
import lzma
import math
import re
import tempfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import dimod
import highspy
import numpy as np

from dispatcher_daemon.formulations.milp import QuietHighs
from research.models.milp import MilpModel
from research.models.qubo import QuboFile, qubo_of
from slipstream.errors import InputError
from slipstream.files import read_file

_MAX_BYTES: Final = 100_000_000
_PACKED: Final[dict[str, Callable[[], Any]]] = {
    ".xz": lzma.LZMADecompressor,
    ".gz": lambda: zlib.decompressobj(31),
}


def read_model(path: Path) -> QuboFile | MilpModel:
    """Read a model; one of binary variables without constraints is a QUBO.

    Raises:
        InputError: naming file, line and mend: it is missing, too large, malformed, or has what no
            solver takes.
    """
    ending = path.suffixes[-1].lower() if path.suffixes else ""
    data = read_file(path, _MAX_BYTES)
    if ending in _PACKED:
        data = _unpacked(data, ending, path)
        ending = Path(path.stem).suffix.lower()
    if ending not in _READERS:
        mend = f"end its name in {', '.join(ENDINGS)}, packed with {' or '.join(_PACKED)} or not"
        raise InputError(path, "no such kind of model file", mend)
    return _READERS[ending](data, path)


def _unpacked(data: bytes, ending: str, path: Path) -> bytes:
    try:
        # One byte more than allowed tells that there is more.
        found: bytes = _PACKED[ending]().decompress(data, _MAX_BYTES + 1)
    except (lzma.LZMAError, zlib.error, EOFError) as error:
        raise InputError(path, f"cannot be unpacked: {error}", "pack it again") from None
    if len(found) > _MAX_BYTES:
        problem = f"unpacked it is larger than {_MAX_BYTES // 10**6} MB"
        raise InputError(path, problem, "give a smaller model")
    return found


def _linear(data: bytes, path: Path) -> QuboFile | MilpModel:
    solver: Any = QuietHighs()
    ending = ".mps" if ".mps" in path.suffixes else ".lp"
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"model{ending}"
        copy.write_bytes(data)
        status = solver.readModel(str(copy))
    if status == highspy.HighsStatus.kError:
        mend = f"give a file in the {ending.removeprefix('.').upper()} format"
        raise InputError(path, "HiGHS cannot read it", mend)
    model = solver.getModel()
    lp, quadratic = model.lp_, model.hessian_.dim_ > 0
    if not lp.num_col_:
        raise InputError(path, "no variable", "give a model with variables")
    if not lp.col_names_:
        lp.col_names_ = [f"x{i}" for i in range(lp.num_col_)]
    binary = len(lp.integrality_) == lp.num_col_ and all(
        kind == highspy.HighsVarType.kInteger for kind in lp.integrality_
    )
    binary = binary and not np.any(lp.col_lower_) and bool(np.all(np.array(lp.col_upper_) == 1))
    if binary and not lp.num_row_:
        return _checked(lambda: _from_highs(model), path)
    if quadratic:
        what = "constraints" if lp.num_row_ else "variables that are not binary"
        mend = "linearise it, or give it as a QUBO with penalties"
        raise InputError(path, f"a quadratic objective and {what}", mend)
    return MilpModel(lp)


def _from_highs(model: Any) -> QuboFile:
    """HiGHS minimises c x + ½ x Q x and keeps the lower half of Q by columns."""
    lp, hessian = model.lp_, model.hessian_
    bqm: Any = dimod.BinaryQuadraticModel("BINARY")
    for name, cost in zip(lp.col_names_, lp.col_cost_, strict=True):
        bqm.add_linear(name, float(cost))
    for column in range(hessian.dim_):
        for at in range(hessian.start_[column], hessian.start_[column + 1]):
            row, value = hessian.index_[at], float(hessian.value_[at])
            if row == column:
                bqm.add_linear(lp.col_names_[column], value / 2)
            else:
                bqm.add_quadratic(lp.col_names_[row], lp.col_names_[column], value)
    bqm.offset = float(lp.offset_)
    return qubo_of(bqm, maximise=lp.sense_ == highspy.ObjSense.kMaximize)


def _qs(data: bytes, path: Path) -> QuboFile:
    """ZIMPL's: an entry beside the diagonal counts twice, x from 1 on, the offset in a comment."""
    bqm: Any = dimod.BinaryQuadraticModel("BINARY")
    size: int | None = None
    left = 0
    for number, words in _lines(data):
        if words[0] == "#":
            if len(words) == 3 and words[1] == "ObjectiveOffset":
                bqm.offset = _number(words[2], path, number)
            continue
        if size is None:
            if len(words) != 2:
                raise _faulty(path, number, "not 'variables entries'")
            size, left = (_index(word, path, number) for word in words)
            if size > _MAX_QS_VARIABLES:
                raise _faulty(path, number, f"{size} variables")
            for i in range(1, size + 1):
                bqm.add_variable(str(i))
            continue
        if len(words) != 3 or not left:
            raise _faulty(path, number, "not 'i j value'" if left else "more entries than stated")
        i, j = (_index(word, path, number) for word in words[:2])
        if not (1 <= i <= size and 1 <= j <= size):
            raise _faulty(path, number, f"a variable that is not from 1 to {size}")
        value = _number(words[2], path, number)
        if i == j:
            bqm.add_linear(str(i), value)
        else:
            bqm.add_quadratic(str(i), str(j), 2 * value)
        left -= 1
    if size is None or left:
        raise InputError(path, f"cut off: {left} entries are missing", "give the whole file")
    return _checked(lambda: qubo_of(bqm), path)


_MAX_QS_VARIABLES: Final = 1_000_000


def _coo(data: bytes, path: Path) -> QuboFile:
    """dimod's coordinates: ``i j bias`` a line; a comment may say ``vartype=`` and ``offset=``."""
    bqm: Any = dimod.BinaryQuadraticModel("BINARY")
    for number, words in _lines(data):
        if words[0].startswith("#"):
            line = " ".join(words)
            kind = re.search(r"vartype[:=] ?(\w+)", line)
            if kind is not None and kind[1].upper() not in ("BINARY", "SPIN"):
                raise _faulty(path, number, f"variables of type {kind[1]}")
            if kind is not None and bqm.num_variables:
                raise _faulty(path, number, "the type after the first entry")
            if kind is not None:
                bqm = dimod.BinaryQuadraticModel(kind[1].upper())
            offset = re.search(r"offset[:=] ?(\S+)", line)
            if offset is not None:
                bqm.offset = _number(offset[1], path, number)
            continue
        if len(words) != 3:
            raise _faulty(path, number, "not 'i j bias'")
        i, j = (_index(word, path, number) for word in words[:2])
        value = _number(words[2], path, number)
        if i == j:
            bqm.add_linear(i, value)
        else:
            bqm.add_quadratic(i, j, value)
    return _checked(lambda: qubo_of(bqm), path)


def _json(data: bytes, path: Path) -> QuboFile:
    bqm: Any = dimod.BinaryQuadraticModel
    return _checked(lambda: qubo_of(bqm.from_serializable(json.loads(data))), path)


def _bqm(data: bytes, path: Path) -> QuboFile:
    bqm: Any = dimod.BinaryQuadraticModel
    return _checked(lambda: qubo_of(bqm.from_file(io.BytesIO(data))), path)


def _checked(make: Callable[[], QuboFile], path: Path) -> QuboFile:
    """The model, or one line of what is wrong with it; dimod raises most kinds of errors."""
    try:
        return make()
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RuntimeError,
        TypeError,
        ValueError,
    ) as error:
        problem = " ".join(str(error).split())[:200] or type(error).__name__
        mend = "give a QUBO in the format of the file's name"
        raise InputError(path, problem, mend) from None


def _lines(data: bytes) -> Iterator[tuple[int, list[str]]]:
    for number, line in enumerate(data.decode("utf-8", "replace").split("\n"), 1):
        words = line.split()
        if words:
            yield number, words


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


_READERS: Final[dict[str, Callable[[bytes, Path], QuboFile | MilpModel]]] = {
    ".lp": _linear,
    ".mps": _linear,
    ".qs": _qs,
    ".coo": _coo,
    ".json": _json,
    ".bqm": _bqm,
}
ENDINGS: Final = tuple(_READERS)
"""Of the files' names."""

"""Models from files, by the ending of the file's name: LP and MPS by HiGHS, QUBOs as coordinates,
dimod's ``.json`` and ``.bqm``. Each may be packed.
"""

from __future__ import annotations

import bz2
import gzip
import io
import json
import lzma
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import dimod
import highspy
import numpy as np

from slipstream.errors import InputError
from slipstream.files import ending_of, read_file, text_of
from slipstream_lab.research.models.coordinates import (
    Vartype,
    biq_qubo,
    coo_qubo,
    max_cut,
    qbsolv_qubo,
    qs_qubo,
)
from slipstream_lab.research.models.highs import read_linear
from slipstream_lab.research.models.milp import MilpModel
from slipstream_lab.research.models.qubo import QuboFile, qubo_of

_MAX_BYTES: Final = 100_000_000
_PACKED: Final[dict[str, Callable[[Any], Any]]] = {
    ".xz": lzma.open,
    ".gz": gzip.open,
    ".bz2": bz2.open,
}


def read_model(
    path: Path, vartype: Vartype | None = None, form: str | None = None
) -> QuboFile | MilpModel:
    """Read a model; one of binary variables without constraints is a QUBO.

    Args:
        form: its format, one of `FORMATS`; None: the file's ending says it.

    Raises:
        InputError: naming file, line and mend: it is missing, too large, malformed, or has what no
            solver takes; also a `vartype` for another format, or against the file's own.
    """
    ending = ending_of(path)
    data = read_file(path, _MAX_BYTES)
    if ending in _PACKED:
        data = _unpacked(data, ending, path)
        ending = ending_of(Path(path.stem))
    ending = ending if form is None else f".{form}"
    if ending not in _READERS:
        mend = f"end its name in {', '.join(_READERS)}, packed or not, or give --format"
        raise InputError(path, "no such kind of model file", mend)
    read = _READERS[ending]
    if vartype is not None:
        if ending != ".coo":
            raise InputError("--vartype", "only for .coo: other formats say it", "leave it out")
        read = _text(partial(coo_qubo, vartype=vartype))
    return _checked(lambda: read(data, path), path)


def _unpacked(data: bytes, ending: str, path: Path) -> bytes:
    try:
        # One byte more than allowed tells that there is more.
        with _PACKED[ending](io.BytesIO(data)) as file:
            found: bytes = file.read(_MAX_BYTES + 1)
    except (lzma.LZMAError, zlib.error, EOFError, OSError) as error:
        raise InputError(path, f"cannot be unpacked: {error}", "pack it again") from None
    if len(found) > _MAX_BYTES:
        problem = f"unpacked it is larger than {_MAX_BYTES // 10**6} MB"
        raise InputError(path, problem, "give a smaller model")
    return found


def _linear(text: str, path: Path, ending: str) -> QuboFile | MilpModel:
    solver: Any
    solver, is_read, warnings = read_linear(text, ending)
    if not is_read:
        reason = f": {warnings[0]}" if warnings else ""
        mend = f"give a file in the {ending.removeprefix('.').upper()} format"
        raise InputError(path, f"HiGHS cannot read it{reason}", mend)
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
        return replace(_from_highs(model), warnings=warnings)
    if quadratic:
        what = "constraints" if lp.num_row_ else "variables that are not binary"
        mend = "linearise it, or give it as a QUBO with penalties"
        raise InputError(path, f"a quadratic objective and {what}", mend)
    return MilpModel(lp, warnings)


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


def _json(text: str, _: Path) -> QuboFile:
    bqm: Any = dimod.BinaryQuadraticModel
    return qubo_of(bqm.from_serializable(json.loads(text)))


def _bqm(data: bytes, _: Path) -> QuboFile:
    bqm: Any = dimod.BinaryQuadraticModel
    return qubo_of(bqm.from_file(io.BytesIO(data)))


def _checked(make: Callable[[], QuboFile | MilpModel], path: Path) -> QuboFile | MilpModel:
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
        mend = "give a model in the format of the file's name"
        raise InputError(path, problem, mend) from None


_Reader = Callable[[bytes, Path], QuboFile | MilpModel]


def _text(read: Callable[[str, Path], QuboFile | MilpModel]) -> _Reader:
    return lambda data, path: read(text_of(data, path), path)


_READERS: Final[dict[str, _Reader]] = {
    ".lp": _text(partial(_linear, ending=".lp")),
    ".mps": _text(partial(_linear, ending=".mps")),
    ".qs": _text(qs_qubo),
    ".coo": _text(coo_qubo),
    ".qubo": _text(qbsolv_qubo),
    ".sparse": _text(biq_qubo),
    ".bq": _text(biq_qubo),
    ".mc": _text(max_cut),
    ".rud": _text(max_cut),
    ".rudy": _text(max_cut),
    ".json": _text(_json),
    ".bqm": _bqm,
}
FORMATS: Final = tuple(ending.removeprefix(".") for ending in _READERS)
"""As files' names end in, in small letters."""

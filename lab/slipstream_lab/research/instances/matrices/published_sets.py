"""The published sets of vehicle routing problems as instances."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from slipstream_lab.research.instances.matrices.instance import MatrixInstance, matrix_instance_from
from slipstream_lab.research.instances.matrices.set_files import set_text
from slipstream_lab.research.instances.matrices.solomon import solomon_data
from slipstream_lab.research.instances.matrices.solutions import with_best_known
from slipstream_lab.research.instances.matrices.vrplib import vrplib_data

SetFormat = Literal["vrplib", "solomon", "qoblib"]


def read_published(path: Path, form: SetFormat, solution: Path | None = None) -> MatrixInstance:
    """Read one instance of a published set.

    Args:
        form: "qoblib" is VRPLIB's with as many vehicles as the name ends with, -k4: more are not
            allowed there.
        solution: a file with its best known cost; None: the one of the same name with the suffix
            .sol, if there is one; of QOBLIB also .opt.sol and .bst.sol, there or in the folder
            `solutions` beside.

    Raises:
        InputError: naming file, line and mend: the file is missing, too large or malformed, or has
            what instances with matrices cannot express.
    """
    text = set_text(path)
    if form == "solomon":
        data = solomon_data(text, path)
    else:
        data = vrplib_data(text, path, exact_vehicles=form == "qoblib")
    if solution is None:
        solution = next((p for p in _solutions(path, form) if p.exists()), None)
    instance = matrix_instance_from(data, path)
    return instance if solution is None else with_best_known(data, instance, solution)


def _solutions(path: Path, form: SetFormat) -> Iterator[Path]:
    """Where a solution may lie."""
    yield path.with_suffix(".sol")
    yield path.with_suffix(".SOL")
    if form == "qoblib":
        for folder in (path.parent, path.parent.parent / "solutions"):
            for kind in ("opt", "bst"):
                yield folder / f"{path.stem}.{kind}.sol"

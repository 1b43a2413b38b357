"""The published sets of vehicle routing problems as instances."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from research.instances.matrices.instance import MatrixInstance, matrix_instance_from
from research.instances.matrices.set_files import number_in, set_text
from research.instances.matrices.solomon import solomon_data
from research.instances.matrices.vrplib import vrplib_data
from slipstream.errors import InputError

SetFormat = Literal["vrplib", "solomon"]


def read_published(path: Path, form: SetFormat, solution: Path | None = None) -> MatrixInstance:
    """Read one instance of a published set.

    Args:
        solution: a file with its best known cost; None: the one of the same name with the suffix
            .sol, if there is one.

    Raises:
        InputError: naming file, line and mend: the file is missing, too large or malformed, or has
            what instances with matrices cannot express.
    """
    text = set_text(path)
    data = vrplib_data(text, path) if form == "vrplib" else solomon_data(text, path)
    if solution is None and path.with_suffix(".sol").exists():
        solution = path.with_suffix(".sol")
    if solution is not None:
        data["best_known"] = {"cost": _best_cost(solution), "source": solution.name[:200]}
    return matrix_instance_from(data, path)


def _best_cost(path: Path) -> float:
    for number, line in enumerate(set_text(path).splitlines(), 1):
        words = line.replace(":", " ").split()
        if len(words) == 2 and words[0].lower() == "cost":
            return number_in(words[1], path, number)
    raise InputError(path, "no line 'Cost ...'", "give a solution file of CVRPLIB")

"""Models as files that other tools read: MILP as LP or MPS, QUBO as JSON, coordinates or QS."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import dimod
import highspy

from dispatcher_daemon.forms.milp import QuietHighs, build_milp
from dispatcher_daemon.forms.problem import ArcProblem, BinaryProblem, Problem
from dispatcher_daemon.forms.qubo import QuboModel
from slipstream.files import ending_of


def write_milp(problem: Problem, path: Path) -> None:
    """Write the MILP in the format of the file's name, ``.lp`` or ``.mps``.

    Columns are called x{i}_..., y{i}_... and u{i}_...; x{i} is arc or option i.

    Raises:
        OSError: the file cannot be written.
        RuntimeError: HiGHS does not write it.
    """
    lp = build_milp(problem)
    lp.col_names_ = column_names(problem)
    lp.row_names_ = [f"r{i}" for i in range(lp.num_row_)]
    solver: Any = QuietHighs()
    solver.passModel(lp)
    with TemporaryDirectory() as folder:
        # HiGHS knows endings in small letters, and does not say what is wrong with a path.
        copy = Path(folder) / f"{path.stem}{ending_of(path)}"
        if solver.writeModel(str(copy)) == highspy.HighsStatus.kError:
            raise RuntimeError(f"HiGHS cannot write {path}")
        path.write_bytes(copy.read_bytes())


def column_names(problem: Problem) -> list[str]:
    """Names of the MILP's columns in their order; letters, digits and underscores only."""
    if isinstance(problem, ArcProblem):
        x = [f"{a.vehicle}_{a.start}_{a.end}" for a in problem.arcs]
        orders = list(problem.customers)
    elif isinstance(problem, BinaryProblem):
        x, orders = list(problem.names), []
    else:
        x = [f"{o.vehicle}_{'_'.join(o.stops)}" for o in problem.options]
        orders = []
    y = [f"{first}_{second}" for first, second in problem.pair_savings]
    return [
        re.sub(r"\W", "_", f"{kind}{i}_{name}", flags=re.ASCII)[:200]
        for kind, names in (("x", x), ("y", y), ("u", orders))
        for i, name in enumerate(names)
    ]


def write_qubo_json(model: QuboModel, path: Path) -> None:
    """Write H_total as dimod's serialisable JSON, variables under their printed names.

    `dimod.BinaryQuadraticModel.from_serializable` reads it.
    """
    document = _with_text_labels(model).to_serializable()
    document["info"] = {"gamma_kwh": model.gamma, "unit": "kWh"}
    path.write_text(json.dumps(document) + "\n", encoding="utf-8")


def write_qubo_coo(model: QuboModel, path: Path) -> None:
    """Write H_total less its offset as coordinates: ``i j bias`` a line, i = j being linear.

    Comment lines hold the offset and the variables' names.
    """
    total = model.total
    index = {variable: i for i, variable in enumerate(model.variables)}
    lines = [f"# vartype=BINARY offset={float(total.offset)!r} gamma_kwh={model.gamma!r}"]
    lines += [f"# {i} {variable}" for variable, i in index.items()]
    lines += [f"{i} {i} {float(total.get_linear(v))!r}" for v, i in index.items()]
    pairs = sorted(
        (*sorted((index[u], index[v])), float(bias)) for (u, v), bias in total.quadratic.items()
    )
    lines += [f"{i} {j} {bias!r}" for i, j, bias in pairs if bias]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_qubo_qs(model: QuboModel, path: Path) -> None:
    """Write H_total as ``.qs``, as ZIMPL does: variables from 1 on, the number of entries above.

    An entry counts once on the diagonal and twice beside it, where half of the bias is written, as
    in a symmetric matrix of which the upper half is stored. The offset is in a comment.
    """
    total = model.total
    index = {variable: i for i, variable in enumerate(model.variables, 1)}
    entries = [(i, i, float(total.get_linear(v))) for v, i in index.items()]
    for (u, v), bias in total.quadratic.items():
        i, j = sorted((index[u], index[v]))
        entries.append((i, j, float(bias) / 2))
    entries = sorted(entry for entry in entries if entry[2])
    lines = [
        "# kWh, binary variables:",
        *(f"# {i} {variable}" for variable, i in index.items()),
        f"# ObjectiveOffset {float(total.offset)!r}",
        "# Vars Non-zeros",
        f"{len(index)} {len(entries)}",
        *(f"{i} {j} {bias!r}" for i, j, bias in entries),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _with_text_labels(model: QuboModel) -> Any:
    named: Any = dimod.BinaryQuadraticModel(model.total)
    named.relabel_variables({variable: str(variable) for variable in model.variables})
    return named


WRITERS: dict[str, Callable[[QuboModel, Path], None]] = {
    ".lp": lambda model, path: write_milp(model.problem, path),
    ".mps": lambda model, path: write_milp(model.problem, path),
    ".json": write_qubo_json,
    ".coo": write_qubo_coo,
    ".qs": write_qubo_qs,
}
"""Writers by ending of the file's name, in small letters."""

"""Models as files that other tools read: MILP as LP or MPS, QUBO as JSON, coordinates or QS."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import dimod

from dispatcher_daemon.forms import QuboModel
from dispatcher_daemon.forms.files import write_milp


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

"""The MILP as a file that other solvers read, LP or MPS."""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import highspy

from dispatcher_daemon.forms.milp import QuietHighs, build_milp
from dispatcher_daemon.forms.problem import ArcProblem, BinaryProblem, Problem
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

"""`slipstream solve --model`: anybody's model, by the solvers that can take it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from slipstream.errors import InputError
from slipstream_lab.commands.solve.quantum import (
    check_fit,
    check_options,
    lines_of,
    make_solvers,
    records,
)

if TYPE_CHECKING:
    from dispatcher_daemon.solvers import Outcome
    from slipstream_lab.research.models import MilpAnswer, MilpModel, QuboFile

_NOT_FOR_IT: Final = ("instance", "form", "objective", "gamma", "write", "explain", "job")
_FOR_QUBOS: Final = ("exact", "cplex", "tabu", "annealing", "lc-qaoa", "qaoa")
_COSTS: Final = ("best_cost", "best_cost_raw", "optimal_cost")


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the option that names a model."""
    command.add_argument(
        "--model",
        type=Path,
        metavar="FILE",
        help="instead of an instance: a MILP (.lp, .mps), a QUBO (.qs, .coo, .qubo, .sparse, .bq, "
        "dimod's .json or .bqm, .lp without constraints) or a graph to cut (.mc, .rud, .rudy), "
        "also packed (.xz, .gz, .bz2)",
    )
    command.add_argument(
        "--format",
        metavar="ENDING",
        help="of a model whose name does not end in it, such as mc for the Biq Mac library's "
        "g05_60.0",
    )
    command.add_argument(
        "--vartype",
        choices=("BINARY", "SPIN"),
        type=str.upper,
        help="of a .coo that does not say it: bits (0 or 1) or spins (-1 or 1)",
    )


def solve_model(options: argparse.Namespace) -> int:
    """Read the model, solve it, report; exit status 1 if no solver found an answer."""
    from slipstream_lab.research.models import FORMATS, MilpModel, read_model

    for name in _NOT_FOR_IT:
        if getattr(options, name):
            raise InputError(f"--{name}", "not for --model", "leave one of them out")
    names = tuple(dict.fromkeys(options.solver or ["exact"]))
    check_options(options, names)
    form = None if options.format is None else options.format.lower().removeprefix(".")
    if form is not None and form not in FORMATS:
        raise InputError("--format", f"no format {form!r}", f"take one of {', '.join(FORMATS)}")
    model = read_model(options.model, options.vartype, form)
    if isinstance(model, MilpModel):
        return _solve_milp(options, names, model)
    return _solve_qubo(options, names, model)


def _solve_milp(options: argparse.Namespace, names: Sequence[str], model: MilpModel) -> int:
    from slipstream_lab.research.models import solve_milp_model

    others = [name for name in names if name != "exact"]
    if others:
        problem = f"{others[0]} solves QUBOs, {options.model} has constraints or other variables"
        mend = "take exact, or write the model as a QUBO with penalties"
        raise InputError("solve", problem, mend, key="--solver")
    answer = solve_milp_model(model, options.deadline, options.seed)
    lp, warnings = model.lp, [*model.warnings, *answer.warnings]
    head = {
        "model": str(options.model),
        "kind": "milp",
        "variables": lp.num_col_,
        "integers": model.integers,
        "constraints": lp.num_row_,
        "sense": "maximise" if model.maximised else "minimise",
        "warnings": warnings,
    }
    if options.json:
        row = {key: value for key, value in vars(answer).items() if key != "warnings"}
        print(json.dumps({**head, "solvers": [{"solver": "exact", **row}]}))
    else:
        print(
            f"{options.model}: MILP, {lp.num_col_} variables, {model.integers} of them integer, "
            f"{lp.num_row_} constraints, {'maximised' if model.maximised else 'minimised'}"
        )
        print("".join(f"warning: {warning}\n" for warning in warnings), end="")
        print("\n".join(_milp_lines(answer)))
    return 0 if answer.objective is not None else 1


def _milp_lines(answer: MilpAnswer) -> Iterator[str]:
    objective = "no answer" if answer.objective is None else f"objective {answer.objective:.10g}"
    bound = "" if answer.bound is None else f", bound {answer.bound:.10g}"
    yield f"exact: {answer.status}, {objective}{bound}, {1000 * answer.wall_s:.1f} ms"
    for name, value in answer.values.items():
        yield f"  {name} = {value:.10g}"


def _solve_qubo(options: argparse.Namespace, names: Sequence[str], model: QuboFile) -> int:
    from dispatcher_daemon.forms import build_model
    from dispatcher_daemon.solvers.workers import PoolJob, solve_in_process

    for name in names:
        if name not in _FOR_QUBOS:
            mend = f"take one of {', '.join(_FOR_QUBOS)}"
            raise InputError("solve", f"{name} takes no model", mend, key="--solver")
    qubo = build_model(model.problem)
    check_fit(options, names, "model", qubo)
    solvers = make_solvers(names, options)
    for solver in solvers:
        solver.warm_up()
    solve = solve_in_process(solvers)
    outcomes = [
        solve([PoolJob(solver.name, model.problem, options.seed)], options.deadline)[0]
        for solver in solvers
    ]
    of_circuits: dict[str, dict[str, Any]] = {}
    if any(outcome.execution is not None for outcome in outcomes):
        best = _best_known(model, outcomes, options)
        of_circuits = records(qubo, outcomes, best, options)
    rows = [_row(model, outcome) for outcome in outcomes]
    if options.json:
        head = {
            "model": str(options.model),
            "kind": "qubo",
            "variables": len(model.problem.names),
            "couplings": model.couplings,
            "sense": "maximise" if model.scale < 0 else "minimise",
            "warnings": list(model.warnings),
        }
        in_units = {name: _in_units(model, record) for name, record in of_circuits.items()}
        rows = [row | in_units.get(row["solver"], {}) for row in rows]
        print(json.dumps({**head, "solvers": rows}))
    else:
        sense = "maximised" if model.scale < 0 else "minimised"
        print(
            f"{options.model}: QUBO, {len(model.problem.names)} variables, {model.couplings} "
            f"couplings, {sense}"
        )
        print("".join(f"warning: {warning}\n" for warning in model.warnings), end="")
        for row in rows:
            print("\n".join(_qubo_lines(row, of_circuits.get(row["solver"]))))
    return 0 if any(outcome.selected is not None for outcome in outcomes) else 1


def _best_known(
    model: QuboFile, outcomes: Sequence[Outcome], options: argparse.Namespace
) -> tuple[float | None, bool]:
    """As the solvers count: the optimum, and that it is proven; or the best, and that it is not."""
    from dispatcher_daemon.solvers import ExactSolver

    found = list(outcomes)
    if not any(outcome.status == "optimal" for outcome in found):
        found.append(ExactSolver().solve(model.problem, options.deadline, options.seed))
    values = [
        model.problem.objective_kwh(outcome.selected)
        for outcome in found
        if outcome.selected is not None
    ]
    return min(values, default=None), any(outcome.status == "optimal" for outcome in found)


def _row(model: QuboFile, outcome: Outcome) -> dict[str, Any]:
    selected = outcome.selected
    return {
        "solver": outcome.solver,
        "status": outcome.status,
        "reason": outcome.reason,
        "objective": None if selected is None else model.objective(selected),
        "ones": None if selected is None else [model.problem.names[i] for i in sorted(selected)],
        "wall_s": outcome.wall_s,
    }


def _in_units(model: QuboFile, record: Mapping[str, Any]) -> dict[str, Any]:
    """The record with costs in the model's own units."""

    def own(row: Mapping[str, Any]) -> dict[str, Any]:
        costs = {key: row[key] for key in _COSTS if row.get(key) is not None}
        return {**row, **{key: model.value(cost) for key, cost in costs.items()}}

    return own(record) | {"controls": {n: own(row) for n, row in record["controls"].items()}}


def _qubo_lines(row: Mapping[str, Any], record: Mapping[str, Any] | None) -> Iterator[str]:
    objective = "no answer" if row["objective"] is None else f"objective {row['objective']:.10g}"
    yield f"{row['solver']}: {row['status']}, {objective}, {1000 * row['wall_s']:.1f} ms"
    if row["reason"] is not None:
        yield f"  {row['reason']}"
    if record is not None:
        yield from lines_of(record, row["wall_s"])
    if row["ones"] is not None:
        yield f"  1: {' '.join(row['ones']) or 'none'}"

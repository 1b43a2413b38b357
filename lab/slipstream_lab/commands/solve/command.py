"""`slipstream solve`: one instance, one or several solvers in turn."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slipstream.config import read_data
from slipstream.errors import InputError
from slipstream.files import ending_of
from slipstream_lab.commands.solve import model as solve_model
from slipstream_lab.commands.solve import vroom as solve_vroom
from slipstream_lab.commands.solve.matrices import solve_matrices
from slipstream_lab.commands.solve.missed import missed_rewards
from slipstream_lab.commands.solve.quantum import (
    add_options,
    best_known_kwh,
    check_fit,
    check_options,
    make_solvers,
    records,
    settings_of,
)
from slipstream_lab.commands.solve.report import Report, as_json, as_text, list_as_text

if TYPE_CHECKING:
    from dispatcher_daemon.forms import QuboModel
    from slipstream_lab.research.instances.forms import Form
    from slipstream_lab.research.instances.instance import Instance
    from slipstream_lab.research.instances.matrices import MatrixInstance

_ENDINGS = (".lp", ".mps", ".json", ".coo", ".qs")
_LARGEST_ARC_FLEET = 2


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "solve",
        help="solve one instance",
        description="Solves one instance and says what the answer costs, what it saves against the "
        "plan without platooning, and why. Exit status 1 if no solver found a valid plan.",
    )
    command.add_argument("--instance", metavar="NAME|FILE", help="published instance, or a file")
    command.add_argument(
        "--solver",
        nargs="+",
        metavar="NAME",
        help="one or several, each in turn; an unknown name is answered with all names "
        "(default: exact)",
    )
    command.add_argument(
        "--form",
        choices=("arc", "route"),
        help="the paper's arcs or route options (default: arc for at most "
        f"{_LARGEST_ARC_FLEET} vehicles)",
    )
    command.add_argument(
        "--objective",
        choices=("energy", "paper"),
        help="what a path costs: its exact drive, or its segments at planning speed "
        "(default: the instance's)",
    )
    command.add_argument(
        "--encoding",
        choices=("reduced", "full"),
        default="reduced",
        help="of the arc form's subtour terms in the QUBO (full: the paper's)",
    )
    command.add_argument(
        "--options",
        type=int,
        default=5,
        metavar="N",
        help="of each vehicle in the route form, at most (default: 5)",
    )
    command.add_argument(
        "--gamma", type=_positive, metavar="G", help="penalty weight, kWh (default: computed)"
    )
    command.add_argument(
        "--deadline", type=_positive, default=10.0, metavar="S", help="for each solver, s"
    )
    command.add_argument("--seed", type=_seed, default=1, help="of all solvers")
    command.add_argument(
        "--explain", action="store_true", help="list every reward and why others are 0"
    )
    command.add_argument(
        "--write",
        type=Path,
        metavar="FILE",
        help="write the MILP (.lp, .mps) or the QUBO (.json for dimod, .coo, .qs); solves only if "
        "--solver is given",
    )
    command.add_argument("--list", action="store_true", help="list the published instances")
    command.add_argument(
        "--schema", action="store_true", help="print the JSON schema of instance files"
    )
    command.add_argument("--json", action="store_true", help="print the results as JSON")
    add_options(command)
    solve_model.add_options(command)
    solve_vroom.add_options(command)
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """List, describe, write or solve."""
    if options.schema:
        from slipstream_lab.research.instances.instance import instance_schema

        print(json.dumps(instance_schema(), indent=2))
        return 0
    if options.list:
        rows = _published()
        print(json.dumps({"instances": rows}) if options.json else list_as_text(rows))
        return 0
    for name in ("format", "vartype"):
        if options.model is None and getattr(options, name) is not None:
            raise InputError(f"--{name}", "only for --model", "leave it out")
    if options.vroom is not None:
        return solve_vroom.answer(options)
    for name in solve_vroom.ONLY_FOR_IT:
        if getattr(options, name):
            raise InputError(f"--{name.replace('_', '-')}", "only for --vroom", "leave it out")
    if options.model is not None:
        return solve_model.solve_model(options)
    if options.instance is None:
        raise InputError(
            "solve", "no instance", "give --instance, see --list for names, or --model"
        )
    if options.write is not None and ending_of(options.write) not in _ENDINGS:
        raise InputError(
            options.write, "no such kind of model file", f"end its name in {', '.join(_ENDINGS)}"
        )
    return _solve(options)


def _solve(options: argparse.Namespace) -> int:
    from dispatcher_daemon.forms import build_model
    from slipstream_lab.research.instances import open_instance
    from slipstream_lab.research.instances.forms import references_kwh

    matrices = _with_matrices(options.instance)
    if matrices is not None:
        return solve_matrices(options, matrices)
    names = options.solver or ([] if options.write else ["exact"])
    check_options(options, names)
    instance = open_instance(options.instance)
    if options.objective:
        instance = instance.under(options.objective)
    form = _form(options, instance)
    model = build_model(form.problem, options.gamma, encoding=options.encoding)
    check_fit(options, names, form.name, model)
    if options.write is not None:
        _write(model, options.write)
    known = instance.known
    if known is not None and (known.form != form.name or form.unserved):
        known = None
    report = Report(
        instance=instance.name,
        form=form.name,
        minimises=instance.problem.objective,
        encoding=options.encoding if form.name == "arc" else None,
        choices=form.problem.choices,
        variables=len(model.variables),
        couplings=sum(1 for bias in model.total.quadratic.values() if bias),
        gamma_kwh=model.gamma,
        gamma_computed=options.gamma is None,
        unserved=form.unserved,
        written=options.write,
        rewards=[(pair, form.arcs) for pair in form.judged] if options.explain else None,
        known=known,
        references_kwh=references_kwh(form),
        problem=form.problem,
    )
    if names:
        _run_solvers(names, options, form, model, instance, report)
    print(json.dumps(as_json(report)) if options.json else as_text(report))
    return 0 if not names or any(tried.candidate for tried in report.attempts) else 1


def _with_matrices(reference: str) -> MatrixInstance | None:
    """The instance, if it is a file with matrices instead of roads."""
    from slipstream_lab.research.instances import instance_names
    from slipstream_lab.research.instances.matrices import has_matrices, matrix_instance_from

    path = Path(reference)
    if reference in instance_names() or not path.suffix:
        return None
    data = read_data(path)
    return matrix_instance_from(data, path) if has_matrices(data) else None


def _form(options: argparse.Namespace, instance: Instance) -> Form:
    from slipstream_lab.research.instances.forms import arc_form_of, route_form_of

    few = len(instance.problem.fleet.vehicles) <= _LARGEST_ARC_FLEET
    if (options.form or ("arc" if few else "route")) == "arc":
        return arc_form_of(instance, options.seed)
    return route_form_of(instance, options.seed, settings_of(options))


def _run_solvers(
    names: Sequence[str],
    options: argparse.Namespace,
    form: Form,
    model: QuboModel,
    instance: Instance,
    report: Report,
) -> None:
    from dispatcher_daemon.planning.plans import Candidate
    from dispatcher_daemon.solvers import ExactSolver
    from dispatcher_daemon.solvers.workers import PoolJob, solve_in_process
    from slipstream_lab.research.instances.forms import attempt, baseline

    solvers = make_solvers(names, options)
    for solver in solvers:
        solver.warm_up()  # says what is not installed before anything takes time
    name, alone = baseline(form, solve_in_process([ExactSolver()]), options.deadline)
    if isinstance(alone, Candidate):
        report.baseline_name, report.baseline = f"{name}, without platooning", alone
    solve = solve_in_process(solvers)
    for solver in solvers:
        (outcome,) = solve([PoolJob(solver.name, form.problem, options.seed)], options.deadline)
        tried = attempt(form, outcome)
        report.attempts.append(tried)
        report.missed[solver.name] = missed_rewards(form, tried, instance.sync_window_s)
    if any(tried.outcome.execution is not None for tried in report.attempts):
        best = best_known_kwh(form, report.attempts, options.deadline, options.seed)
        outcomes = [tried.outcome for tried in report.attempts]
        report.quantum = records(model, outcomes, best, options)


def _write(model: QuboModel, path: Path) -> None:
    from slipstream_lab.research.models.write import WRITERS

    try:
        WRITERS[ending_of(path)](model, path)
    except OSError as error:
        raise InputError(
            path, error.strerror or "not writable", "give a path that can be written"
        ) from None


def _published() -> list[dict[str, Any]]:
    """Sizes and optima of the published instances."""
    from dispatcher_daemon.forms import build_model
    from slipstream_lab.research.instances import instance_names, open_instance
    from slipstream_lab.research.instances.forms import arc_form_of

    rows = []
    for name in instance_names():
        instance = open_instance(name)
        fleet, optimum, exact = (
            instance.problem.fleet,
            instance.optimum,
            instance.energy_optimum,
        )
        problem = arc_form_of(instance).problem
        rows.append(
            {
                "name": name,
                "form": "arc",
                "vehicles": len(fleet.vehicles),
                "stops": len(fleet.stops),
                "choices": problem.choices,
                "variables": len(build_model(problem).variables),
                "rewards": len(problem.pair_savings),
                "optimum_kwh": None if optimum is None else optimum.objective_kwh,
                "energy_optimum_kwh": None if exact is None else exact.objective_kwh,
                "proven": optimum is not None and optimum.proven,
                "provenance": instance.provenance,
            }
        )
    return rows


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def _seed(text: str) -> int:
    value = int(text) if text.isdecimal() else -1
    if not 0 <= value < 2**32:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to {2**32 - 1}")
    return value

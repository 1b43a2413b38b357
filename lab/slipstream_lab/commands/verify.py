"""`slipstream verify`: look at every state of a QUBO and say whether it is exact."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from slipstream.errors import InputError
from slipstream_cli.progress import ProgressLine

if TYPE_CHECKING:
    from dispatcher_daemon.forms import Encoding, Problem
    from slipstream_lab.research.proofs.proof import Proof

_PAPER_GAMMA_KWH = 50.0
_RANDOM_VARIABLES = 25
_MAX_RANDOM = 10_000
_OPTIONS = 5
_MAX_OPTIONS = 30
_MAX_ARCS = 1_000
"""Fleets with more are refused before anything is computed."""

Case = tuple[str, str, "Problem"]
"""Name, form and problem."""


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "verify",
        help="enumerate small QUBOs: are they exact?",
        description="Looks at every state of the QUBO and checks that zero penalty means a valid "
        "route set and nothing else, that its minimum is the MILP's optimum, and that every "
        "infeasible state lies above every feasible one. Beyond 30 variables, auxiliary bits that "
        "hang together are enumerated by themselves. Exit status 1 if a check fails.",
    )
    command.add_argument(
        "instances", nargs="*", metavar="NAME|FILE", help="published instance, or instance file"
    )
    command.add_argument("--all", action="store_true", help="all published instances")
    command.add_argument(
        "--random", type=int, default=0, metavar="N", help="N random problems of each form as well"
    )
    command.add_argument("--seed", type=int, default=1, help="of random problems and route options")
    command.add_argument(
        "--gamma",
        nargs="+",
        metavar="G",
        default=["bound", str(_PAPER_GAMMA_KWH)],
        help="penalty weights, kWh, or 'bound' for the computed one (default: bound and 50)",
    )
    command.add_argument(
        "--form",
        choices=("arc", "route"),
        default="arc",
        help="of the named instances: the paper's arcs (default) or route options",
    )
    command.add_argument(
        "--options", type=int, default=_OPTIONS, metavar="N", help="route form: most of a vehicle"
    )
    command.add_argument(
        "--encoding",
        choices=("reduced", "full"),
        default="reduced",
        help="of the arc form's subtour terms (default: reduced; full: the paper's)",
    )
    command.add_argument("--json", action="store_true", help="print the checks as JSON")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check what was named; stop at bad input before the first enumeration."""
    from slipstream_lab.research.proofs.proof import prove

    weights = [_gamma(text) for text in options.gamma]
    cases, left_out = _cases(options)
    rows: list[dict[str, Any]] = []
    if not options.json:
        print(_HEAD)
    with ProgressLine("verify", sys.stderr) as progress:
        for number, ((name, form, problem), gamma) in enumerate(
            ((case, weight) for case in cases for weight in weights), start=1
        ):
            proof = prove(problem, gamma, options.encoding)
            encoding = options.encoding if form == "arc" else None
            rows.append({"name": name, "form": form, "encoding": encoding} | _row(proof, gamma))
            if not options.json:
                print(_line(rows[-1]))
            progress.update(number, len(cases) * len(weights))
    failed = sum(not row["holds"] for row in rows)
    if options.json:
        print(json.dumps({"checks": rows, "failed": failed, "left_out": left_out}))
    else:
        for name, variables in left_out.items():
            print(f"{name}: left out, {variables} variables are too many to enumerate")
        print(f"{len(rows)} checks, {failed} failed")
    return 1 if failed else 0


def _gamma(text: str) -> float | None:
    if text == "bound":
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise InputError(
            "verify", f"{text!r} is no weight", "give kWh > 0, or 'bound'", key="--gamma"
        )
    return value


def _cases(options: argparse.Namespace) -> tuple[list[Case], dict[str, int]]:
    """What is to be checked, and what of all published instances is too large for it."""
    from dispatcher_daemon.forms import MAX_VARIABLES
    from slipstream_lab.research.instances import instance_names
    from slipstream_lab.research.proofs.eliminate import MAX_CHOICES

    if not 0 <= options.random <= _MAX_RANDOM or options.seed < 0:
        key = "--seed" if options.seed < 0 else "--random"
        raise InputError("verify", "out of range", f"give 0 to {_MAX_RANDOM}", key=key)
    if not 1 <= options.options <= _MAX_OPTIONS:
        raise InputError("verify", "out of range", f"give 1 to {_MAX_OPTIONS}", key="--options")
    if not (options.instances or options.all or options.random):
        raise InputError(
            "verify", "nothing to check", "name instances, or give --all or --random N"
        )
    named: list[Case] = []
    left_out: dict[str, int] = {}
    every = instance_names() if options.all else ()
    for name in dict.fromkeys([*options.instances, *every]):
        problem = _problem(name, options)
        variables, small = _size(problem, options.encoding)
        if small:
            named.append((name, options.form, problem))
        elif name in options.instances:
            encoding = f"{options.encoding} encoding of the " if options.form == "arc" else ""
            raise InputError(
                name,
                f"{variables} variables in the {encoding}{options.form} form",
                f"take a smaller instance: at most {MAX_VARIABLES}, or {MAX_CHOICES} x and parts "
                f"of at most {MAX_VARIABLES}",
            )
        else:
            left_out[name] = variables
    return [*named, *_random(options.random, options.seed, options.encoding)], left_out


def _problem(reference: str, options: argparse.Namespace) -> Problem:
    from dispatcher_daemon.settings import CitySettings, DispatcherSettings
    from slipstream_lab.research.instances import open_instance
    from slipstream_lab.research.instances.forms import arc_form_of, route_form_of

    instance = open_instance(reference)
    fleet = instance.problem.fleet
    most = len(fleet.vehicles) * (len(fleet.pooled) + 1) ** 2
    if most > _MAX_ARCS:
        raise InputError(
            reference, f"up to {most} candidate arcs", "take an instance of a few stops"
        )
    if options.form == "arc":
        return arc_form_of(instance).problem
    settings = DispatcherSettings(city=CitySettings(options=options.options))
    return route_form_of(instance, options.seed, settings).problem


def _size(problem: Problem, encoding: Encoding) -> tuple[int, bool]:
    """Number of variables, and whether all their states can be looked at."""
    from dispatcher_daemon.forms import MAX_VARIABLES, build_model
    from slipstream_lab.research.proofs.proof import can_prove

    if problem.choices > MAX_VARIABLES:
        return problem.choices, False
    model = build_model(problem, 1.0, encoding=encoding)
    return len(model.variables), can_prove(model)


def _random(number: int, seed: int, encoding: Encoding) -> Iterator[Case]:
    import numpy as np

    from slipstream_lab.research.instances.random_problems import (
        random_arc_problem,
        random_route_problem,
    )

    for i in range(number):
        rng = np.random.default_rng([seed, 0, i])
        yield f"random-arc-{i}", "arc", random_arc_problem(rng, _RANDOM_VARIABLES, encoding)
    for i in range(number):
        rng = np.random.default_rng([seed, 1, i])
        yield f"random-route-{i}", "route", random_route_problem(rng, _RANDOM_VARIABLES)


def _row(proof: Proof, gamma: float | None) -> dict[str, Any]:
    """Plain data of one check; infinite bounds, where there is no such state, are null."""
    found = proof.found
    return {
        "variables": proof.variables,
        "choices": proof.choices,
        "states": found.states,
        "gamma": "bound" if gamma is None else "given",
        "gamma_kwh": proof.gamma_kwh,
        "holds": proof.holds,
        "zero_penalty_is_valid": proof.equivalent,
        "minimum_is_milp_optimum": proof.minimum_matches,
        "infeasible_above_feasible": found.separated,
        "valid_selections": found.valid_selections,
        "feasible_states": found.feasible_states,
        "minimum_kwh": found.minimum_kwh,
        "milp_status": proof.milp.status,
        "milp_kwh": proof.milp.objective_kwh,
        "highest_feasible_kwh": _finite(found.highest_feasible_kwh),
        "lowest_infeasible_kwh": _finite(found.lowest_infeasible_kwh),
        "spread": found.spread,
        "wall_s": proof.wall_s,
        "faults": list(proof.faults()),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


_HEAD = (
    f"{'instance':<20} {'variables':>9} {'valid':>6} {'gamma kWh':>10} {'minimum kWh':>12} "
    f"{'spread':>9} {'s':>6}  result"
)


def _line(row: dict[str, Any]) -> str:
    faults: Iterable[str] = row["faults"]
    minimum = "none" if row["feasible_states"] == 0 else f"{row['minimum_kwh']:.6f}"
    return (
        f"{row['name']:<20} {row['variables']:>9} {row['valid_selections']:>6} "
        f"{row['gamma_kwh']:>10.4f} {minimum:>12} {row['spread']:>9.2e} {row['wall_s']:>6.2f}  "
        f"{'exact' if row['holds'] else 'FAILS: ' + '; '.join(faults)}"
    )

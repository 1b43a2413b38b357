"""What `slipstream solve` asks and tells of quantum solvers."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from slipstream.errors import InputError

if TYPE_CHECKING:
    from dispatcher_daemon.forms import QuboModel
    from dispatcher_daemon.settings import DispatcherSettings
    from dispatcher_daemon.solvers import Outcome, Solver
    from slipstream_lab.research.instances.forms import Attempt, Form

QUANTUM_SOLVERS: Final = ("lc-qaoa", "qaoa", "iskay")
_OPTION_OF_FIELD: Final = {
    "layers": "--p",
    "shots": "--shots",
    "variant": "--variant",
    "iterations": "--iterations",
}
_OPTIONS: Final = ("p", "backend", "shots", "variant", "iterations", "job")


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the options of quantum solvers."""
    group = command.add_argument_group("quantum solvers")
    group.add_argument("--p", type=int, metavar="N", help="layers (default: 2)")
    group.add_argument(
        "--backend",
        metavar="NAME",
        help="aer, aer:FakeBoston (or another fake device: with its noise; +fractional: RZZ and RX "
        "gates added; +idle: idle and coherent errors added, against which +dd and +twirl may "
        "follow), ibm:NAME, ibm:least-busy (default: aer)",
    )
    group.add_argument("--shots", type=int, metavar="N", help="samples (default: 4096)")
    group.add_argument(
        "--variant",
        metavar="NAME",
        help="of the algorithm, as in the settings: docs/settings.md (default: lc-qaoa: trained; "
        "qaoa: x)",
    )
    group.add_argument("--iterations", type=int, metavar="N", help="of training, at most")
    group.add_argument("--job", metavar="ID", help="take up an earlier job of iskay")
    group.add_argument(
        "--no-controls", action="store_true", help="leave out the samples without a circuit"
    )


def check_options(options: argparse.Namespace, names: Sequence[str]) -> None:
    """Refuse unknown solvers, options that none of the solvers has, and values out of bounds.
    Raises InputError: naming the option.
    """
    from dispatcher_daemon.settings import solver_names

    known = tuple(dict.fromkeys((*solver_names(), *QUANTUM_SOLVERS)))
    for name in names:
        if name not in known:
            raise InputError(
                "solve",
                f"there is no solver {name!r}",
                f"take one of {', '.join(known)}",
                key="--solver",
            )
    if not set(names) & set(QUANTUM_SOLVERS):
        for option in _OPTIONS:
            if getattr(options, option) is not None:
                raise InputError(
                    "solve",
                    "only quantum solvers have this option",
                    f"add --solver {'|'.join(QUANTUM_SOLVERS)}",
                    key=f"--{option}",
                )
    settings_of(options)
    if options.job is not None and "iskay" not in names:
        raise InputError("solve", "only iskay takes up a job", "add --solver iskay", key="--job")
    if options.job is not None and not re.fullmatch(r"[\w-]{1,100}", options.job):
        raise InputError("solve", "no id of a job", "give the id as it was printed", key="--job")


def check_fit(
    options: argparse.Namespace, names: Sequence[str], form: str, model: QuboModel
) -> None:
    """Refuse what no simulation or device can do, before anything takes time.

    Args:
        form: arc, route, or "model" where it is anybody's.

    Raises:
        InputError: a back end is unknown or has no credentials; too many qubits for it or for a
            state vector; a one-hot variant of another form than route.
    """
    variant = options.variant or ""
    if form != "route" and (variant.startswith("one-hot") or variant == "xy"):
        mend = "add --form route" if form == "arc" else "take another one"
        raise InputError("solve", "this variant needs route options", mend, key="--variant")
    if "qaoa" in names:
        from dispatcher_daemon.solvers.quantum.statevector import MAX_QUBITS

        if options.backend not in (None, "aer"):
            raise InputError(
                "solve",
                "qaoa is simulated exactly, its circuit fits no device's connections",
                "take --solver lc-qaoa, or leave the back end out",
                key="--backend",
            )
        if variant != "xy" and len(model.variables) > MAX_QUBITS:
            raise InputError(
                "solve",
                f"{len(model.variables)} qubits do not fit a state vector of {MAX_QUBITS}",
                "take --solver lc-qaoa or a smaller instance",
                key="--solver",
            )
    if "lc-qaoa" in names and options.backend is not None:
        _check_backend(options.backend, len(model.variables))


def _check_backend(text: str, qubits: int) -> None:
    from dispatcher_daemon.solvers.quantum.backends import find_access
    from slipstream_lab.research.quantum.backends.opening import open_backend

    service, _, device = text.partition(":")
    if service == "ibm" and device:
        find_access()  # a device that fails is no bad input, missing credentials are
        return
    try:
        open_backend(text).place(qubits)
    except InputError as error:
        problem = error.problem if device in error.problem else f"{text}: {error.problem}"
        raise InputError("solve", problem, error.mend, key="--backend") from None


def _given(options: argparse.Namespace) -> dict[str, Any]:
    """What the command line says of a circuit, by field."""
    return {
        field: value
        for field, option in _OPTION_OF_FIELD.items()
        if (value := getattr(options, option.removeprefix("--"))) is not None
    }


def settings_of(options: argparse.Namespace) -> DispatcherSettings:
    """Settings with what was given on the command line; their types set its choices and bounds.
    Raises InputError: naming the option: a solver has no such variant, or takes no such number.
    """
    from dispatcher_daemon.settings import DispatcherSettings
    from slipstream.config import check
    from slipstream_lab.research.quantum.angles import QaoaAsked

    given = _given(options)
    asked = options.solver or ()
    data: dict[str, Any] = {"gamma": options.gamma, "city": {"options": options.options}}
    if "lc-qaoa" in asked:
        data["lc_qaoa"] = given
    elif "iskay" in asked:
        data["lc_qaoa"] = {k: v for k, v in given.items() if k in ("shots", "iterations")}
    if "qaoa" in asked and "variant" in given:
        data["qaoa"] = {"variant": given["variant"]}
    try:
        settings = check(data, DispatcherSettings, "solve")
        if "qaoa" in asked:
            check({"qaoa": given}, QaoaAsked, "solve")
        return settings
    except InputError as error:
        section, _, field = (error.key or "").partition(".")
        option = "--options" if section == "city" else _OPTION_OF_FIELD.get(field, error.key)
        solver = section.replace("_", "-")
        whose = f"{solver}: " if solver in QUANTUM_SOLVERS else ""
        alone = len(set(asked)) == 1 or not whose
        mend = error.mend if alone else "solve with one solver at a time"
        raise InputError("solve", whose + error.problem, mend, key=option) from None


def make_solvers(names: Sequence[str], options: argparse.Namespace) -> list[Solver]:
    """The solvers by name, each once. Raises InputError: what they need is missing: credentials, a
    device, a variant.
    """
    from dispatcher_daemon.solvers import make_solver
    from dispatcher_daemon.solvers.quantum import LcQaoaSolver
    from slipstream_lab.research.quantum.angles import QaoaOptions, make_qaoa
    from slipstream_lab.research.quantum.backends.opening import open_or_fall_back

    settings = settings_of(options)
    solvers: list[Solver] = []
    for name in dict.fromkeys(names):
        if name == "iskay":
            solvers.append(_iskay(options))
        elif name == "qaoa":
            asked = QaoaOptions.model_validate(_given(options))
            solvers.append(make_qaoa(asked, settings.gamma, options.encoding))
        elif name == "lc-qaoa" and options.backend is not None:
            backend = partial(open_or_fall_back, options.backend)
            solvers.append(
                LcQaoaSolver(settings.lc_qaoa, settings.gamma, options.encoding, backend)
            )
        else:
            solvers.append(make_solver(name, settings, options.encoding))
    return solvers


def _iskay(options: argparse.Namespace) -> Solver:
    from dispatcher_daemon.solvers.quantum.backends import find_access
    from slipstream_lab.research.quantum.backends.iskay import IskaySolver

    kind, _, device = (options.backend or "").partition(":")
    if kind != "ibm" or not device or device == "least-busy":
        raise InputError(
            "solve", "iskay runs on a named IBM device", "give --backend ibm:NAME", key="--backend"
        )
    solver = IskaySolver(
        find_access(), device, job=options.job, gamma=options.gamma, encoding=options.encoding
    )
    changes = {"shots": options.shots, "iterations": options.iterations}
    return replace(solver, **{name: value for name, value in changes.items() if value is not None})


def records(
    model: QuboModel,
    outcomes: Sequence[Outcome],
    best: tuple[float | None, bool],
    options: argparse.Namespace,
) -> dict[str, dict[str, Any]]:
    """Records by solver, of those with a circuit; see `run_record`.

    Beside its fields: ``optimum_proven``, ``seed``, ``iterations`` (of training, as asked; None
    where nothing is trained), ``deadline_s``.
    """
    from slipstream_lab.research.quantum.controls import distributions, run_controls
    from slipstream_lab.research.quantum.record import run_record

    optimum_kwh, proven = best
    iterations = _iterations(options)
    found = {}
    for outcome in outcomes:
        if outcome.execution is None:
            continue
        controls = {}
        if outcome.samples is not None and not options.no_controls:
            of = distributions(model, outcome)
            controls = run_controls(model, of, outcome.samples.shots, options.seed)
        record = run_record(outcome, outcome.execution, controls, optimum_kwh)
        found[outcome.solver] = record | {
            "optimum_proven": proven,
            "seed": options.seed,
            "iterations": iterations.get(outcome.solver),
            "deadline_s": options.deadline,
        }
    return found


def _iterations(options: argparse.Namespace) -> dict[str, int]:
    """Of each solver that trains, the most iterations."""
    settings = settings_of(options)
    found = {} if options.iterations is None else {"iskay": options.iterations}
    if settings.lc_qaoa.variant != "ramp":
        found["lc-qaoa"] = settings.lc_qaoa.iterations
    if options.iterations is not None:
        found["qaoa"] = options.iterations
    return found


def best_known_kwh(
    form: Form, attempts: Sequence[Attempt], deadline_s: float, seed: int
) -> tuple[float | None, bool]:
    """The optimum of what the solvers minimised, and that it is proven; or the best answer, and
    that it is not. None without an answer.
    """
    from dispatcher_daemon.solvers import ExactSolver

    answers = [a.outcome.selected for a in attempts if a.candidate is not None]
    known = [form.problem.objective_kwh(selected) for selected in answers if selected is not None]
    proven = any(a.outcome.status == "optimal" for a in attempts)
    if not proven:
        outcome = ExactSolver().solve(form.problem, deadline_s, seed)
        proven = outcome.status == "optimal"
        if outcome.selected is not None:
            known.append(form.problem.objective_kwh(outcome.selected))
    return min(known, default=None), proven


def lines_of(record: Mapping[str, Any], wall_s: float) -> Iterator[str]:
    """A record in lines for people."""
    layers = f", p = {record['p']}" if record["p"] else ""
    qubits = "" if record["qubits"] is None else f", {record['qubits']} qubits"
    yield (
        f"  circuit: {record['variant']}{layers}{qubits} on {record['backend']} ({record['kind']})"
        f"{_gates(record)}; trained {record['train_s']:.2f} s, sampled {record['sample_s']:.2f} s"
    )
    if wall_s > record["deadline_s"]:
        yield (
            f"  late: {wall_s:.2f} s, the deadline was {record['deadline_s']:g} s; what samples "
            "cannot be cut short, training ends in its share"
        )
    if record["fallback"] is not None:
        yield f"  fallback: {record['fallback']}"
    if record["job"] is not None:
        yield f"  job: {record['job']}"
    if record["p_feasible"] is None:
        return
    best = "optimal" if record["optimum_proven"] else "best known (not proven optimal)"
    yield f"  {record['shots']} samples, % feasible / % {best}"
    yield _columns("", ("raw", "descended", "repaired"))
    yield _columns("the circuit", _shares(record))
    for name, control in record["controls"].items():
        yield _columns(name, _shares(control))
        yield _columns("  the circuit adds", _differences(record["added"][name]))


_STAGES: Final = ("", "_descended", "_repaired")


def _columns(title: str, cells: Sequence[str]) -> str:
    return f"    {title:<18}" + "".join(f"{cell:>28}" for cell in cells)


def _gates(record: Mapping[str, Any]) -> str:
    depth, gates = record["two_qubit_depth"], record["two_qubit_gates"]
    return "" if depth is None else f", two-qubit depth {depth}, {gates} two-qubit gates"


def _shares(record: Mapping[str, Any]) -> list[str]:
    def percent(key: str) -> str:
        return "?" if record[key] is None else f"{100 * record[key]:.2f}"

    return [f"{percent('p_feasible' + s)} / {percent('p_optimal' + s)}" for s in _STAGES]


def _differences(added: Mapping[str, Mapping[str, float]]) -> list[str]:
    def points(key: str) -> str:
        if key not in added:
            return "?"
        return f"{100 * added[key]['value']:+.2f} ±{100 * added[key]['standard_error']:.2f}"

    return [f"{points('p_feasible' + s)} / {points('p_optimal' + s)}" for s in _STAGES]

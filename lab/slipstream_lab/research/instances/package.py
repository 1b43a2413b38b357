"""Published instances as a class of a benchmark library: instance, solution, models, checker.

The folders are those of QOBLIB's classes (https://git.zib.de/qopt/qoblib-quantum-optimization-benchmarking-library).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Final
from urllib.parse import quote

from dispatcher_daemon.forms import ArcProblem, build_model
from dispatcher_daemon.planning.arc_form import ArcForm
from slipstream.errors import InputError
from slipstream_lab.research.instances.forms import arc_form_of
from slipstream_lab.research.instances.instance import Instance, Optimum
from slipstream_lab.research.models.write import WRITERS

CHECKER: Final = "check_vrpcp.py"
_LICENCE: Final = "AGPL-3.0-only"
_FOLDERS: Final[Mapping[str, str]] = {
    "lp": "models/integer_linear/lp_files",
    "qs": "models/binary_unconstrained/qs_files",
}


def write_package(instances: Sequence[Instance], folder: Path) -> tuple[Path, ...]:
    """Write instances, solutions, models, the checker and a README; the files in their order.

    Raises:
        InputError: an instance that the arc form cannot express.
        OSError: a file cannot be written.
    """
    texts: dict[str, str] = {}
    models = []
    rows = []
    for instance in instances:
        form = _whole_form(instance)
        known, name = _known(instance), file_name(instance)
        texts[f"instances/{name}.vrpcp"] = instance_text(instance, form.problem)
        if known is not None:
            kind = "opt" if known.proven else "bst"
            texts[f"solutions/{name}.{kind}.sol"] = solution_text(form.problem, known)
        model = build_model(form.problem)
        models += [(model, f"{of}/{name}.{ending}") for ending, of in _FOLDERS.items()]
        rows.append(_row(instance, form.problem, len(model.variables), known))
    texts[f"check/{CHECKER}"] = (resources.files(__package__) / CHECKER).read_text("utf-8")
    texts["README.md"] = _readme(rows)
    paths = {folder / name: text for name, text in texts.items()}
    for path, text in paths.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    for model, name in models:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        WRITERS[path.suffix](model, path)
    return (*paths, *(folder / name for _, name in models))


def file_name(instance: Instance) -> str:
    """The instance's name as that of a file, without its ending."""
    return re.sub(r"[^A-Za-z0-9._-]", "_", instance.name).lstrip(".") or "instance"


def write_model(instance: Instance, path: Path) -> None:
    """Write the arc form's model in the format of the file's name; see `WRITERS`.

    Raises:
        InputError: an instance that the arc form cannot express.
        OSError: the file cannot be written.
    """
    WRITERS[path.suffix](build_model(_whole_form(instance).problem), path)


def instance_text(instance: Instance, problem: ArcProblem) -> str:
    """The file that the checker reads."""
    places = (problem.depot, *problem.customers)
    place = {name: i for i, name in enumerate(places)}
    vehicle = {name: i for i, name in enumerate(problem.vehicles, 1)}
    known = _known(instance)
    lines = [
        f"NAME : {file_name(instance)}",
        f"COMMENT : {' '.join(instance.provenance.split()) or 'no provenance given'}",
        f"LICENCE : {_LICENCE}",
        "TYPE : VRPCP",
        f"OBJECTIVE : {instance.problem.objective}, kWh",
        f"BEST_KNOWN : {_best(known)}",
        f"DIMENSION : {len(places)}",
        f"VEHICLES : {len(problem.vehicles)}",
        f"ARCS : {len(problem.arcs)}",
        f"PAIRS : {len(problem.pair_savings)}",
        "PLACE_SECTION",
        *(f"{i} {quote(name)}" for name, i in place.items()),
        "VEHICLE_SECTION",
        *(f"{i} {quote(name)}" for name, i in vehicle.items()),
        "ARC_SECTION",
        *(
            f"{i} {vehicle[a.vehicle]} {place[a.start]} {place[a.end]} {float(a.cost_kwh)!r}"
            for i, a in enumerate(problem.arcs, 1)
        ),
        "PLATOON_SECTION",
        *(f"{a + 1} {b + 1} {float(saving)!r}" for (a, b), saving in problem.pair_savings.items()),
        "EOF",
    ]
    return "\n".join(lines) + "\n"


def solution_text(problem: ArcProblem, known: Optimum) -> str:
    """A known solution as the checker reads it."""
    place = {name: i for i, name in enumerate(problem.customers, 1)}
    lines = [
        f"Route #{i}: {' '.join(str(place[stop]) for stop in known.routes[vehicle])}"
        for i, vehicle in enumerate(problem.vehicles, 1)
    ]
    return "\n".join([*lines, f"Cost {known.objective_kwh!r}"]) + "\n"


def _whole_form(instance: Instance) -> ArcForm:
    form = arc_form_of(instance)
    if form.unserved:
        stop = next(iter(form.unserved))
        mend = "take it out of the instance"
        raise InputError(instance.name, f"stop {stop!r} cannot be served", mend, key="fleet.stops")
    return form


def _known(instance: Instance) -> Optimum | None:
    known = instance.known
    return known if known is not None and known.form == "arc" else None


def _best(known: Optimum | None) -> str:
    if known is None:
        return "unknown"
    proof = "proven optimal" if known.proven else "not proven"
    return f"{known.objective_kwh!r} ({proof}: {' '.join(known.method.split())})"


def _row(
    instance: Instance, problem: ArcProblem, variables: int, known: Optimum | None
) -> tuple[str, ...]:
    return (
        instance.name,
        str(len(problem.vehicles)),
        str(len(problem.customers)),
        str(len(problem.arcs)),
        str(len(problem.pair_savings)),
        str(variables),
        "unknown" if known is None else f"{known.objective_kwh:.9f}" + "*" * known.proven,
        instance.provenance or "not given",
    )


_HEADS: Final = (
    *("Instance", "Vehicles", "Customers", "Arcs", "Pairs that save", "Binary variables (QUBO)"),
    *("Best objective, kWh", "Generator"),
)


def _readme(rows: Sequence[tuple[str, ...]]) -> str:
    return "\n".join([*_README.splitlines(), "", *_table(rows)]) + "\n"


def _table(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    yield f"| {' | '.join(_HEADS)} |"
    yield "|" + " --- |" * len(_HEADS)
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', '/') for cell in row)} |"


_README: Final = f"""# Vehicle routing with cooperative platooning (VRPCP)

Vehicles of one depot visit customers. Each customer is visited once, by one of them; each vehicle
drives one closed tour over at least one customer, by arcs of its own. Pairs of arcs of two vehicles
save energy if both are driven, because the vehicles then drive close behind each other on a road
that both arcs share. Minimise the arcs' energy less these savings, in kWh.

- `instances/NAME.vrpcp`: places (0 is the depot), vehicles, arcs (number, vehicle, start, end,
  kWh), pairs of arcs (first, second, kWh saved).
- `solutions/NAME.opt.sol`: proven optimal; `NAME.bst.sol`: the best known. A line
  `Route #k: c1 c2 ...` for each vehicle k, and `Cost N`.
- `check/{CHECKER}`: `python check/{CHECKER} instances/NAME.vrpcp solutions/NAME.opt.sol`. One file,
  Python's standard library only.
- `{_FOLDERS["lp"]}`: the linearised MILP. `{_FOLDERS["qs"]}`: the QUBO with penalties;
  as in all `.qs` files, a pair's entry counts twice and the offset is in a comment.

Licence: {_LICENCE}, that of Slipstream, whose generator drew the instances. * proven optimal.
"""

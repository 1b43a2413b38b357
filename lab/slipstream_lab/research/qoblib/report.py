"""Tables of the referee, and its runs in the form in which QOBLIB takes submissions."""

from __future__ import annotations

import csv
import io
import os
import platform
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from slipstream import __version__
from slipstream_lab.research.instances.matrices import read_published
from slipstream_lab.research.qoblib.bench import QoblibCase, QoblibSettings, best_cost
from slipstream_lab.research.qoblib.cover import CoverModel, build_cover
from slipstream_lab.research.qoblib.solvers import SOLVERS, Record, SolverName

COLUMNS: Final = (
    *("Problem", "Submitter", "Date", "Reference", "Best Objective Value", "Optimality Bound"),
    *("Modeling Approach", "# Decision Variables", "# Binary Variables", "# Integer Variables"),
    *("# Continuous Variables", "# Non-Zero Coefficients", "Coefficients Type"),
    *("Coefficients Range", "Workflow", "Algorithm Type", "# Runs", "# Feasible Runs"),
    *("# Successful Runs", "Success Threshold", "Hardware Specifications", "Total Runtime"),
    *("CPU Runtime", "GPU Runtime", "QPU Runtime", "Other HW Runtime", "Remarks"),
)
"""Of QOBLIB's misc/submission_template.csv."""

_NONE: Final = "N/A"
_WORKFLOWS: Final[Mapping[SolverName, str]] = {
    "exact": "all routes listed; set partitioning by HiGHS",
    "pyvrp": "iterated local search over routes by PyVRP, in rounds",
    "annealing": "simulated annealing on the QUBO (dwave-samplers), as long as the circuit took",
    "circuit": "LC-QAOA on a chain, trained and sampled exactly without noise; one-flip descent",
    "marginals": "the trained circuit's one-qubit probabilities, sampled independently; one-flip "
    "descent; training included, as long as the circuit took",
    "no-gates": "the circuit without entangling gates, trained alike; one-flip descent; as long as "
    "the circuit took",
    "descent": "uniform random bits; one-flip descent; as long as the circuit took",
    "uniform": "uniform random bits, as long as the circuit took",
}


@dataclass(frozen=True)
class QoblibLine:
    """One solver on one instance.

    Attributes:
        spread: standard deviation of the cost over the feasible runs; None of fewer than two.
        samples, valid, hits: of all runs: drawn, and of those choices of valid routes and of the
            best known cost, after the solver's own post-processing; None of solvers that do not
            sample.
    """

    instance: str
    solver: SolverName
    runs: int
    feasible: int
    optimal: int
    best: float | None
    gap: float | None
    spread: float | None
    cpu_s: float
    samples: int | None
    valid: int | None
    hits: int | None
    reason: str | None


def lines_of(cases: Sequence[QoblibCase]) -> list[QoblibLine]:
    """Of all solvers that have run on the cases."""
    return [
        _line(case, solver, runs) for case in cases for solver, runs in case.runs.items() if runs
    ]


def _line(case: QoblibCase, solver: SolverName, runs: Sequence[Record]) -> QoblibLine:
    costs = [r["cost"] for r in runs if r["cost"] is not None]
    best = best_cost(case)
    sampled = [r for r in runs if r.get("samples") is not None]
    return QoblibLine(
        case.name,
        solver,
        len(runs),
        len(costs),
        sum(_is_best(cost, best) for cost in costs),
        min(costs, default=None),
        statistics.fmean(costs) / best - 1 if costs and best else None,
        statistics.stdev(costs) if len(costs) > 1 else None,
        sum(r["cpu_s"] or 0.0 for r in runs),
        sum(r["samples"] for r in sampled) if sampled else None,
        sum(r["valid"] for r in sampled) if sampled else None,
        sum(r["at_best"] for r in sampled if _is_best(r["cost"], best)) if sampled else None,
        next((r["reason"] for r in runs if r["reason"]), None),
    )


def _is_best(cost: float | None, best: float | None) -> bool:
    return cost is not None and best is not None and cost <= best * (1 + 1e-9)


def as_json(cases: Sequence[QoblibCase], settings: QoblibSettings) -> dict[str, Any]:
    """The report as plain data, each run included."""
    return {
        "settings": settings.model_dump(mode="json"),
        "hardware": hardware(),
        "instances": [
            {
                "name": case.name,
                "stops": case.stops,
                "vehicles": case.vehicles,
                "routes": case.routes,
                "best_known": best_cost(case),
                "runs": case.runs,
            }
            for case in cases
        ],
        "lines": [asdict(line) for line in lines_of(cases)],
    }


def as_markdown(cases: Sequence[QoblibCase], settings: QoblibSettings) -> str:
    """All instances together, then each of them."""
    lines = lines_of(cases)
    text = [
        f"QOBLIB routing, {len(cases)} instances, seeds 0 to {settings.seeds - 1}, circuit "
        f"{settings.circuit} with p = {settings.layers}, {settings.shots} shots; {hardware()}",
        "",
        "| solver | runs | feasible | optimal | mean gap | CPU s a run | samples | valid | "
        "optimal samples a CPU s |",
        "|---|---|---|---|---|---|---|---|---|",
        *(_together(solver, [x for x in lines if x.solver == solver]) for solver in SOLVERS),
        "",
        "| instance | solver | runs | feasible | optimal | best | gap | spread | CPU s |",
        "|---|---|---|---|---|---|---|---|---|",
        *(
            f"| {x.instance} | {x.solver} | {x.runs} | {x.feasible} | {x.optimal} | "
            f"{_number(x.best, 'g')} | {_number(x.gap, '.2%')} | {_number(x.spread, '.1f')} | "
            f"{x.cpu_s:.1f} |"
            for x in lines
        ),
    ]
    reasons = sorted({f"{x.instance}, {x.solver}: {x.reason}" for x in lines if x.reason})
    return "\n".join([*(line for line in text if line is not None), *reasons])


def _together(solver: SolverName, lines: Sequence[QoblibLine]) -> str | None:
    runs = sum(x.runs for x in lines)
    if not runs:
        return None
    feasible = sum(x.feasible for x in lines)
    gaps = [(x.gap, x.feasible) for x in lines if x.gap is not None]
    gap = sum(g * n for g, n in gaps) / feasible if gaps else None
    samples = sum(x.samples or 0 for x in lines)
    valid, hits = sum(x.valid or 0 for x in lines), sum(x.hits or 0 for x in lines)
    cpu_s = sum(x.cpu_s for x in lines)
    return (
        f"| {solver} | {runs} | {feasible} | {sum(x.optimal for x in lines)} | "
        f"{_number(gap, '.2%')} | {cpu_s / runs:.2f} | {samples or '–'} | "
        f"{_number(valid / samples if samples else None, '.2%')} | "
        f"{_number(hits / cpu_s if samples and cpu_s else None, '.2f')} |"
    )


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def hardware() -> str:
    """Processor, cores and system, in one line."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [
                line.split(":", 1)[1].strip() for line in file if line.startswith("model name")
            ]
        model = names[0] if names else model
    except OSError:
        pass
    return (
        f"{model}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"
    )


def submissions(cases: Sequence[QoblibCase], submitter: str) -> Iterator[tuple[str, str]]:
    """(file, text): a table of all, and of each solver that has routes a folder as QOBLIB asks."""
    table: list[dict[str, str]] = []
    for case in cases:
        model = build_cover(read_published(case.path, "qoblib"), case.path)
        for solver, runs in case.runs.items():
            if not runs:
                continue
            row = _row(case, solver, runs, model, submitter)
            table.append(row)
            answers = [r for r in runs if r["cost"] is not None]
            if answers:
                folder = f"submission/{solver}/{case.name}/{case.name}"
                yield f"{folder}_summary.csv", _as_csv([row])
                best = min(answers, key=lambda r: float(r["cost"]))
                yield f"{folder}_solution.sol", _solution(best)
    yield "summary.csv", _as_csv(table)


def _solution(run: Record) -> str:
    routes = [f"Route #{n}: {' '.join(map(str, r))}" for n, r in enumerate(run["routes"], 1)]
    return "\n".join([*routes, f"Cost {run['cost']:g}"]) + "\n"


def _as_csv(rows: Sequence[Mapping[str, str]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _row(
    case: QoblibCase, solver: SolverName, runs: Sequence[Record], model: CoverModel, submitter: str
) -> dict[str, str]:
    costs = [r["cost"] for r in runs if r["cost"] is not None]
    bounds = [r["bound"] for r in runs if r["bound"] is not None]
    timed = [r for r in runs if r["cpu_s"] is not None]
    line = _line(case, solver, runs)
    values = {
        "Problem": case.name,
        "Submitter": submitter,
        "Date": max(r["date"] for r in runs),
        "Reference": f"Slipstream {__version__}, slipstream bench qoblib (docs/quantum.md)",
        "Best Objective Value": _given(min(costs, default=None)),
        "Optimality Bound": _given(max(bounds, default=None)),
        "Workflow": _WORKFLOWS[solver],
        "Algorithm Type": "Deterministic" if solver == "exact" else "Stochastic",
        "# Runs": str(len(runs)),
        "# Feasible Runs": str(len(costs)),
        # The library's own definition: against the solver's own best.
        "# Successful Runs": str(sum(cost <= min(costs) * (1 + 1e-9) for cost in costs)),
        "Success Threshold": "0",
        "Hardware Specifications": hardware(),
        "Total Runtime": _mean([r["model_s"] + r["wall_s"] for r in timed]),
        "CPU Runtime": _mean([r["cpu_s"] for r in timed]),
        "Remarks": f"seconds, means of the runs; seeds {runs[0]['seed']} to {runs[-1]['seed']}; "
        f"{line.optimal} runs at the best known cost"
        + ("; the circuit is simulated" if solver == "circuit" else ""),
    }
    return dict.fromkeys(COLUMNS, _NONE) | _model(solver, model) | values


def _model(solver: SolverName, model: CoverModel) -> dict[str, str]:
    if solver == "pyvrp":
        return {"Modeling Approach": "routes"}
    size = str(len(model.routes))
    if solver == "exact":
        name, values = "Set partitioning over all routes (MILP)", [*model.costs, *model.rows.flat]
        values = [float(v) for v in values if v]
    else:
        name, bqm = "Set partitioning over all routes with penalties (QUBO)", model.bqm
        values = [float(v) for v in (*bqm.linear.values(), *bqm.quadratic.values()) if v]
    return {
        "Modeling Approach": name,
        "# Decision Variables": size,
        "# Binary Variables": size,
        "# Integer Variables": "0",
        "# Continuous Variables": "0",
        "# Non-Zero Coefficients": str(len(values)),
        "Coefficients Type": "Integer" if all(v.is_integer() for v in values) else "Continuous",
        "Coefficients Range": f"{min(values):g} to {max(values):g}",
    }


def _given(value: float | None) -> str:
    return _NONE if value is None else f"{value:.10g}"


def _mean(values: Sequence[float]) -> str:
    return f"{statistics.fmean(values):.3f}" if values else _NONE

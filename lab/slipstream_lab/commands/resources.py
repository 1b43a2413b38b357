"""`slipstream resources`: the paper's resource table, counted."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from slipstream.errors import InputError
from slipstream.files import ending_of
from slipstream_cli.progress import ProgressLine

if TYPE_CHECKING:
    from slipstream_lab.research.resources.counts import QuboSize, ResourceRow

_MAX_CUSTOMERS: Final = 60
_MAX_VEHICLES: Final = 20
_BENCHMARK: Final = "arc25-01-avenue"
PAPER_BENCHMARK: Final = {
    "arc_variables": 16,
    "order_bits": 8,
    "slack_bits": 1,
    "variables": 25,
    "couplings": 128,
}
"""What the paper prints of its 25-qubit instance (sections III-B and VI-B)."""


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "resources",
        help="variables, constraints and couplings of MILP and QUBO by size",
        description="Counts what the arc form needs on a street grid where every arc is a "
        "candidate and every pair of ways that share a segment has a reward. Sizes with more "
        "vehicles than customers are left out: each vehicle has to drive.",
    )
    command.add_argument(
        "--customers", type=int, nargs="+", default=[4, 10, 20, 50], metavar="N", help="N"
    )
    command.add_argument(
        "--vehicles", type=int, nargs="+", default=[2, 5, 10, 20], metavar="K", help="K"
    )
    command.add_argument("--seed", type=int, default=1, help="of the streets and the customers")
    command.add_argument("--json", action="store_true", help="print the table as JSON")
    command.add_argument("--plot", type=Path, metavar="FILE.png", help="draw it as well")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print the table, and plot it."""
    from slipstream_lab.research.resources.counts import resource_row

    _check(options)
    sizes = [(n, k) for n in options.customers for k in options.vehicles if k <= n]
    if not sizes:
        raise InputError(
            "resources", "more vehicles than customers", "give K ≤ N", key="--vehicles"
        )
    rows = []
    with ProgressLine("resources", sys.stderr) as progress:
        for number, (customers, vehicles) in enumerate(sizes, start=1):
            rows.append(resource_row(customers, vehicles, seed=options.seed))
            progress.update(number, len(sizes))
    ours = _benchmark()
    if options.json:
        benchmark = {"paper": PAPER_BENCHMARK, "instance": _BENCHMARK}
        benchmark |= {encoding: _plain(size) for encoding, size in ours.items()}
        print(json.dumps({"benchmark": benchmark, "rows": [_row(row) for row in rows]}))
    else:
        print(_printed(ours, rows))
    if options.plot is not None:
        _plot(rows, options.plot)
    return 0


def _check(options: argparse.Namespace) -> None:
    for key, values, most in (
        ("--customers", options.customers, _MAX_CUSTOMERS),
        ("--vehicles", options.vehicles, _MAX_VEHICLES),
    ):
        if not all(1 <= value <= most for value in values):
            raise InputError("resources", "out of range", f"give 1 to {most}", key=key)
    if options.seed < 0:
        raise InputError("resources", "out of range", "give 0 or more", key="--seed")
    if options.plot is not None and ending_of(options.plot) not in (".png", ".svg", ".pdf"):
        raise InputError(options.plot, "no picture's suffix", "name it .png", key="--plot")
    if options.plot is not None and not options.plot.absolute().parent.is_dir():
        raise InputError(options.plot, "no such folder", "make it first", key="--plot")


def _benchmark() -> dict[str, QuboSize]:
    from dispatcher_daemon.forms import build_arc_model
    from dispatcher_daemon.planning.arc_form import arc_problem_of
    from slipstream_lab.research.instances import open_instance
    from slipstream_lab.research.resources.counts import model_size

    instance = open_instance(_BENCHMARK)
    problem = arc_problem_of(instance.problem, instance.snapshot, instance.sync_window_s)
    return {
        "reduced": model_size(build_arc_model(problem, encoding="reduced")),
        "full": model_size(build_arc_model(problem, encoding="full")),
    }


def _plain(size: QuboSize) -> dict[str, int]:
    return {**asdict(size), "variables": size.variables}


def _row(row: ResourceRow) -> dict[str, Any]:
    return {**asdict(row), "full": _plain(row.full), "reduced": _plain(row.reduced)}


def _printed(ours: dict[str, QuboSize], rows: list[ResourceRow]) -> str:
    lines = [
        f"4 customers, 2 vehicles, 16 candidate arcs ({_BENCHMARK})",
        f"{'':<14}{'arcs':>6}{'order':>7}{'slack':>7}{'variables':>11}{'couplings':>11}",
        _benchmark_line("paper, printed", PAPER_BENCHMARK),
        *(_benchmark_line(f"{name}", _plain(size)) for name, size in ours.items()),
        "",
        "every arc a candidate, every reward that there can be; p: by the paper's formulas",
        f"{'N':>3} {'K':>3} {'arcs':>7} | {'MILP aux':>11} {'p':>8} {'rows':>11} "
        f"| {'full: order':>11} {'p':>6} {'slack':>7} {'couplings':>11} "
        f"| {'reduced: order':>14} {'slack':>7} {'couplings':>11}",
    ]
    lines += [
        f"{r.customers:>3} {r.vehicles:>3} {r.milp.arc_variables:>7} "
        f"| {r.milp.auxiliaries:>11} {r.paper.milp_auxiliaries:>8} {r.milp.constraints:>11} "
        f"| {r.full.order_bits:>11} {r.paper.qubo_order_bits:>6} {r.full.slack_bits:>7} "
        f"{r.full.couplings:>11} "
        f"| {r.reduced.order_bits:>14} {r.reduced.slack_bits:>7} {r.reduced.couplings:>11}"
        for r in rows
    ]
    return "\n".join(lines)


def _benchmark_line(name: str, size: dict[str, int]) -> str:
    return (
        f"{name:<14}{size['arc_variables']:>6}{size['order_bits']:>7}{size['slack_bits']:>7}"
        f"{size['variables']:>11}{size['couplings']:>11}"
    )


def _plot(rows: list[ResourceRow], path: Path) -> None:
    """Three panels over N: QUBO variables, QUBO couplings, MILP; a colour for each K."""
    from matplotlib.figure import Figure

    panels: tuple[tuple[str, dict[str, Callable[[ResourceRow], int]]], ...] = (
        (
            "QUBO variables",
            {"full": lambda r: r.full.variables, "reduced": lambda r: r.reduced.variables},
        ),
        (
            "QUBO couplings",
            {"full": lambda r: r.full.couplings, "reduced": lambda r: r.reduced.couplings},
        ),
        (
            "MILP",
            {"auxiliaries": lambda r: r.milp.auxiliaries, "rows": lambda r: r.milp.constraints},
        ),
    )
    figure = Figure(figsize=(12, 4), layout="constrained")
    customers = sorted({row.customers for row in rows})
    for axes, (title, series) in zip(figure.subplots(1, 3), panels, strict=True):
        for number, vehicles in enumerate(sorted({row.vehicles for row in rows})):
            group = sorted((r for r in rows if r.vehicles == vehicles), key=lambda r: r.customers)
            for (label, value), style in zip(series.items(), ("o-", "s--"), strict=True):
                axes.plot(
                    [row.customers for row in group],
                    [value(row) for row in group],
                    style,
                    color=f"C{number}",
                    markersize=4,
                    label=f"{label}, K = {vehicles}",
                )
        axes.set(xscale="log", yscale="log", xlabel="customers N", title=title)
        axes.set_xticks(customers, [str(n) for n in customers])
        axes.set_xticks([], minor=True)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    try:
        figure.savefig(path, dpi=150)
    except OSError as error:
        raise InputError(path, error.strerror or "cannot be written", "check the path") from None

"""`python -m slipstream_lab.benchmarks.service`: exit status 0 if all aims are reached.

States: so many segment states a second, and what a message costs. Orders: how soon they are
acknowledged and in a plan. Cluster: the same cycle with 0, 1 and 2 workers.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from slipstream_lab.benchmarks.aims import Check, Load, machine, report_head, write_report
from slipstream_lab.benchmarks.command import Measured, parts_of, report, say, start
from slipstream_lab.benchmarks.orders.__main__ import measure as measure_orders
from slipstream_lab.benchmarks.routing.cluster import runs
from slipstream_lab.benchmarks.service import telemetry
from slipstream_lab.benchmarks.service.costs import message_costs
from slipstream_lab.benchmarks.service.parts import cluster_checks, cluster_table, order_checks

PARTS = ("states", "orders", "cluster")
_WORKERS = (0, 1, 2)

_RSUS = 100
_SEGMENTS = 100
_STEPS = (150, 200, 250, 300)
"""Segments of each RSU beyond the aim, until the first that does not hold: the ceiling."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.service", description=__doc__
    )
    parser.add_argument("--short", action="store_true", help="small ones, minutes, no ceiling")
    parser.add_argument("--only", default=",".join(PARTS), help=f"some of {','.join(PARTS)}")
    parser.add_argument("--out", type=Path, default=Path(".slipstream") / "bench-service")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def run() -> Measured:
        return _measure(options.out, parts_of(options.only, PARTS), options.short)

    return report("bench-service", run, as_json=options.json)


def _measure(out: Path, parts: Sequence[str], short: bool) -> Measured:
    load = Load()
    aims: list[Check] = []
    lines: list[str] = []
    content: dict[str, object] = {}
    if "states" in parts:
        folder = out / "states"
        found = telemetry.measure(_RSUS, _SEGMENTS, 10.0 if short else 60.0, folder, say)
        steps = [found]
        for segments in () if short else _STEPS:
            if not steps[-1].holds:
                break
            steps.append(telemetry.measure(_RSUS, segments, 20.0, folder, say))
        costs = message_costs(5.0 if short else 30.0, folder, say)
        about = {"machine": machine(), **load.figures()}
        aims += telemetry.write(folder, found, steps, costs, about)
        lines += ["", "States: [report](states/report.md)"]
    if "orders" in parts:
        say("orders: a city and a cycle")
        orders = measure_orders(*((20, 100, 20) if short else (200, 1000, 100)), seed=1)
        aims += order_checks(orders)
        content["orders"] = asdict(orders)
    if "cluster" in parts:
        size = {"vehicles": 20, "stops": 60, "segments": 200}
        if not short:
            size = {"vehicles": 60, "stops": 300, "segments": 600}
        made = []
        for one in runs(1, 400.0, _WORKERS, 1, 1, **size):
            say(f"cluster: {one['workers']} workers, {one['wall_s']} s, plan {one['plan']}")
            made.append(one)
        aims += cluster_checks(made)
        lines += ["", *cluster_table(made)]
        content["cluster"] = made
    about = {"machine": machine(), **load.figures()}
    lines = [*report_head("The dispatch service", about, aims), *lines]
    out.mkdir(parents=True, exist_ok=True)
    write_report(out, "\n".join(lines) + "\n", about, content)
    return Measured(out, aims)


if __name__ == "__main__":
    start(main)

"""Orders and the cluster as parts of the service's benchmark: their figures, tables and aims."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slipstream_lab.benchmarks.aims import Check
from slipstream_lab.benchmarks.orders.__main__ import InsertionFigures

MAX_ACKNOWLEDGED_MS = 50.0
MAX_PLACED_MS = 1000.0


def order_checks(found: InsertionFigures) -> list[Check]:
    """The aims of orders: 95th percentiles, and that all are in a plan."""
    aims = []
    for what, seconds, limit_ms in (
        ("an order acknowledged during a cycle, p95", found.during, MAX_ACKNOWLEDGED_MS),
        ("an order acknowledged between cycles, p95", found.between, MAX_ACKNOWLEDGED_MS),
        ("an order in a plan, p95", found.placed, MAX_PLACED_MS),
    ):
        p95_ms = float(np.percentile(1e3 * np.array(seconds), 95)) if seconds else np.inf
        aims.append(Check(what, f"{p95_ms:.0f} ms", f"≤ {limit_ms:g} ms", p95_ms <= limit_ms))
    placed, sent = len(found.placed), len(found.between)
    aims.append(Check("orders in a plan", f"{placed} of {sent}", "all", placed == sent))
    return aims


def cluster_checks(runs: Sequence[dict[str, object]]) -> list[Check]:
    """That every number of workers gave the same plan; not judged where a deadline ended one."""
    plans = {run["plan"] for run in runs}
    late = any(run["timed_out"] for run in runs)
    workers = ", ".join(str(run["workers"]) for run in runs)
    what = f"plans of a cycle with {workers} workers"
    return [Check(what, f"{len(plans)} different", "1", None if late else len(plans) == 1)]


def cluster_table(runs: Sequence[dict[str, object]]) -> list[str]:
    """The runs as lines of a Markdown table."""
    return [
        "| workers | s | objective, kWh | plan | bytes sent | ended by the deadline |",
        "|--:|--:|--:|---|--:|---|",
        *(
            f"| {run['workers']} | {run['wall_s']} | {run['objective_kwh']} | {run['plan']} | "
            f"{run['bytes']:.0f} | {'yes' if run['timed_out'] else 'no'} |"
            for run in runs
        ),
    ]

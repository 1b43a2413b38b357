"""`python -m benchmarks.service`: exit status 0 if all aims are reached."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks.aims import Load, machine
from benchmarks.command import Measured, report, say, start
from benchmarks.service import telemetry
from benchmarks.service.costs import message_costs

_RSUS = 100
_SEGMENTS = 100
_STEPS = (150, 200, 250, 300)
"""Segments of each RSU beyond the aim, until the first that does not hold: the ceiling."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.service", description=__doc__)
    parser.add_argument("--short", action="store_true", help="ten seconds, no ceiling")
    parser.add_argument("--out", type=Path, default=Path(".slipstream") / "bench-service")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def run() -> Measured:
        load = Load()
        seconds = 10.0 if options.short else 60.0
        found = telemetry.measure(_RSUS, _SEGMENTS, seconds, options.out, say)
        steps = [found]
        for segments in () if options.short else _STEPS:
            if not steps[-1].holds:
                break
            steps.append(telemetry.measure(_RSUS, segments, 20.0, options.out, say))
        costs = message_costs(5.0 if options.short else 30.0, options.out, say)
        about = {"machine": machine(), **load.figures()}
        return Measured(options.out, telemetry.write(options.out, found, steps, costs, about))

    return report("bench-service", run, as_json=options.json)


if __name__ == "__main__":
    start(main)

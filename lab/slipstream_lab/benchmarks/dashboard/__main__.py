"""`python -m slipstream_lab.benchmarks.dashboard`: exit status 0 if all aims are reached."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from slipstream_lab.benchmarks.aims import Load, machine
from slipstream_lab.benchmarks.command import Measured, report, say, start
from slipstream_lab.benchmarks.dashboard import bench, past

PILOT = bench.ShownCity(roads=1000, vans=200, rsus=50, max_cpu_share=0.15)
CITY = bench.ShownCity(roads=10_000, vans=1000, rsus=100, max_cpu_share=0.5)
_MEMORY_FROM_S = 600.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.dashboard", description=__doc__
    )
    parser.add_argument("--short", action="store_true", help="twenty seconds, the smaller city")
    parser.add_argument("--seconds", type=float, help="for each city; default 3600 and 60")
    parser.add_argument("--out", type=Path, default=Path(".slipstream") / "bench-dashboard")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def run() -> Measured:
        load, figures, aims = Load(), [], []
        runs = [(PILOT, 20.0 if options.short else options.seconds or 3600.0)]
        if not options.short:
            runs.append((CITY, options.seconds or 60.0))
        for city, seconds in runs:
            found = bench.measure(city, seconds, options.out, say)
            figures.append(found)
            aims += bench.checks(found, memory=seconds >= _MEMORY_FROM_S)
        if not options.short:
            aims += past.checks(past.measure(say))
        bench.write(options.out, figures, aims, {"machine": machine(), **load.figures()})
        return Measured(options.out, aims)

    return report("bench-dashboard", run, as_json=options.json)


if __name__ == "__main__":
    start(main)

"""`python -m slipstream_lab.benchmarks.routing`: exit status 0 if all aims that were measured are
reached.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from slipstream_lab.benchmarks.command import Measured, parts_of, report, say, start
from slipstream_lab.benchmarks.routing.bench import (
    FULL,
    PARTS,
    SHORT,
    RoutingBenchSettings,
    run_bench,
)
from slipstream_lab.benchmarks.routing.report import checks

_DEFAULTS = RoutingBenchSettings()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.routing", description=__doc__
    )
    parser.add_argument("--short", action="store_true", help="small cities, a few minutes")
    parser.add_argument("--only", default=",".join(PARTS), help=f"some of {','.join(PARTS)}")
    parser.add_argument("--out", type=Path, default=_DEFAULTS.out, help="folder for the report")
    parser.add_argument("--plots", type=Path, help="folder for the plots (default: --out)")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def measure() -> Measured:
        settings = RoutingBenchSettings(
            out=options.out,
            plots=options.plots,
            form=SHORT if options.short else FULL,
            parts=parts_of(options.only, PARTS),
        )
        results = run_bench(settings, say)
        return Measured(settings.out, checks(results), results.missing)

    return report("bench-routing", measure, as_json=options.json)


if __name__ == "__main__":
    start(main)

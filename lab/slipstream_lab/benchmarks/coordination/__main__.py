"""`python -m slipstream_lab.benchmarks.coordination`: exit status 0 if all aims that were measured
are reached.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from slipstream_lab.benchmarks.command import Measured, report, say, start
from slipstream_lab.benchmarks.coordination.bench import (
    FULL,
    SHORT,
    CoordinationBenchSettings,
    run_bench,
)
from slipstream_lab.benchmarks.coordination.report import checks

_DEFAULTS = CoordinationBenchSettings()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.coordination", description=__doc__
    )
    parser.add_argument("--short", action="store_true", help="a minute or two")
    parser.add_argument("--out", type=Path, default=_DEFAULTS.out, help="folder for all results")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def measure() -> Measured:
        form = SHORT if options.short else FULL
        results = run_bench(CoordinationBenchSettings(options.out, form), say)
        return Measured(options.out, checks(results))

    return report("bench-coordination", measure, as_json=options.json)


if __name__ == "__main__":
    start(main)

"""`python -m slipstream_lab.benchmarks.agents`: exit status 0 if all aims are reached."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from slipstream_lab.benchmarks.agents.bench import checks, measure, write
from slipstream_lab.benchmarks.aims import Load, machine
from slipstream_lab.benchmarks.command import Measured, report, say, start

_SHORT_S = 5.0
_SECONDS = 60.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.agents", description=__doc__
    )
    parser.add_argument("--short", action="store_true", help="five seconds, twenty agents")
    parser.add_argument("--out", type=Path, default=Path(".slipstream") / "bench-agents")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def run() -> Measured:
        load = Load()
        seconds, vans = (_SHORT_S, 20) if options.short else (_SECONDS, 100)
        one = measure(1, seconds, options.out, say)
        many = measure(vans, seconds, options.out, say)
        write(options.out, one, many, {"machine": machine(), **load.figures()})
        return Measured(options.out, checks(one, many))

    return report("bench-agents", run, as_json=options.json)


if __name__ == "__main__":
    start(main)

"""`python -m slipstream_lab.benchmarks.coordination`: exit status 0 if all aims that were measured
are reached.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from slipstream.errors import InputError
from slipstream_lab.benchmarks.command import Measured, report, say, start
from slipstream_lab.benchmarks.coordination.bench import (
    FULL,
    SHORT,
    CoordinationBenchForm,
    CoordinationBenchSettings,
    run_bench,
    written,
)
from slipstream_lab.benchmarks.coordination.report import checks

_DEFAULTS = CoordinationBenchSettings()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.coordination", description=__doc__
    )
    parser.add_argument("--short", action="store_true", help="a minute or two")
    parser.add_argument("--vehicles", help="a day on the corridor, as 20,100 (default: all)")
    parser.add_argument("--windows", help="± min, as 1,10 (default: 1,5,10,30)")
    parser.add_argument("--prices", help="of waiting, kW, as 0,10 (default: 10,0,27)")
    parser.add_argument("--trucks", type=int, help="in the region; 0: leave it out")
    parser.add_argument("--report-only", action="store_true", help="of what was planned before")
    parser.add_argument("--out", type=Path, default=_DEFAULTS.out, help="folder for all results")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def measure() -> Measured:
        settings = CoordinationBenchSettings(options.out, _form(options))
        results = written(settings) if options.report_only else run_bench(settings, say)
        return Measured(settings.out, checks(results))

    return report("bench-coordination", measure, as_json=options.json)


def _form(options: argparse.Namespace) -> CoordinationBenchForm:
    form = SHORT if options.short else FULL
    if options.vehicles is not None:
        form = replace(form, vehicles=_numbers("--vehicles", options.vehicles, 1))
    if options.windows is not None:
        form = replace(form, windows_min=_numbers("--windows", options.windows, 1))
    if options.prices is not None:
        form = replace(form, prices_kw=_numbers("--prices", options.prices, 0))
    if options.trucks is not None:
        if options.trucks < 0:
            raise InputError("--trucks", f"{options.trucks} trucks", "give 0 or more")
        form = replace(form, trucks=options.trucks)
    return form


def _numbers(option: str, text: str, least: int) -> tuple[int, ...]:
    try:
        numbers = tuple(dict.fromkeys(int(part) for part in text.split(",")))
    except ValueError:
        numbers = ()
    if not numbers or min(numbers) < least:
        problem = f"no whole numbers from {least} on: {text!r}"
        raise InputError(option, problem, "separate them by commas")
    return numbers


if __name__ == "__main__":
    start(main)

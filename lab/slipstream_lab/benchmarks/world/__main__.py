"""`python -m slipstream_lab.benchmarks.world`: exit status 0 if all aims that were measured are
reached.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from slipstream.errors import InputError
from slipstream_lab.benchmarks.command import Measured, parts_of, report, say, start
from slipstream_lab.benchmarks.world.bench import (
    FULL,
    PARTS,
    SHORT,
    WorldBenchForm,
    WorldBenchSettings,
    run_bench,
)
from slipstream_lab.benchmarks.world.report import checks

_DEFAULTS = WorldBenchSettings()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.world", description=__doc__
    )
    parser.add_argument("--short", action="store_true", help="a quarter of an hour, one seed")
    parser.add_argument("--only", default=",".join(PARTS), help=f"some of {','.join(PARTS)}")
    parser.add_argument("--seeds", help="days, as 1,2,3 (default: 1,2,3; short: 1)")
    parser.add_argument("--scenarios", help="some of troy,corridor")
    parser.add_argument("--out", type=Path, default=_DEFAULTS.out, help="folder for all results")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def measure() -> Measured:
        settings = WorldBenchSettings(
            out=options.out,
            form=_form(options),
            seeds=_seeds(options.seeds or ("1" if options.short else "1,2,3")),
            parts=parts_of(options.only, PARTS),
        )
        results = run_bench(settings, say)
        return Measured(settings.out, checks(results), results.missing)

    return report("bench-world", measure, as_json=options.json)


def _form(options: argparse.Namespace) -> WorldBenchForm:
    form = SHORT if options.short else FULL
    if options.scenarios is not None:
        names = tuple(options.scenarios.split(","))
        strange = next((name for name in names if name not in FULL.scenarios), None)
        if strange is not None:
            raise InputError("--scenarios", f"no world {strange!r}", "use troy, corridor")
        form = replace(form, scenarios=names)
    return form


def _seeds(text: str) -> tuple[int, ...]:
    try:
        seeds = tuple(dict.fromkeys(int(part) for part in text.split(",")))
    except ValueError:
        seeds = ()
    if not seeds or min(seeds) < 0:
        raise InputError("--seeds", f"no seeds: {text!r}", "give some as 1,2,3")
    return seeds


if __name__ == "__main__":
    start(main)

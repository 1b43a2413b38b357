"""`python -m benchmarks.routing`: exit status 0 if all aims that were measured are reached."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.routing.bench import FULL, PARTS, SHORT, BenchSettings, parts_of, run_bench
from benchmarks.routing.report import checks
from slipstream.errors import InputError

_DEFAULTS = BenchSettings()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.routing", description=__doc__)
    parser.add_argument("--short", action="store_true", help="small cities, a few minutes")
    parser.add_argument("--only", default=",".join(PARTS), help=f"some of {','.join(PARTS)}")
    parser.add_argument("--out", type=Path, default=_DEFAULTS.out, help="folder for the report")
    parser.add_argument("--plots", type=Path, help="folder for the plots (default: --out)")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)
    try:
        settings = BenchSettings(
            out=options.out,
            plots=options.plots,
            form=SHORT if options.short else FULL,
            parts=tuple(parts_of(options.only)),
        )
        results = run_bench(settings, lambda text: print(text, file=sys.stderr, flush=True))
    except InputError as error:
        print(f"bench-routing: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    print((settings.out / ("report.json" if options.json else "report.md")).read_text(), end="")
    missed = any(check.reached is False for check in checks(results))
    return 1 if missed or results.missing else 0


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(main())

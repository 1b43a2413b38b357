"""`python -m slipstream_lab.benchmarks.soak`: exit status 0 if it is sure that nothing grows and
nothing failed, else 1.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from slipstream.errors import InputError
from slipstream_cli.progress import ProgressLine
from slipstream_lab.benchmarks.aims import Check
from slipstream_lab.benchmarks.command import Measured, report, start
from slipstream_lab.benchmarks.soak.soak import SoakSettings, run_soak

_DEFAULTS = SoakSettings(seconds=300.0)
_SHORTEST_MIN = 0.3


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one soak."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.soak",
        description="The demo's daemons on recorded video, sampled each second; red on growth.",
    )
    parser.add_argument("--minutes", type=float, default=5.0, help="how long (default 5)")
    parser.add_argument("--out", type=Path, default=_DEFAULTS.out, help="folder for the report")
    parser.add_argument("--clips", type=Path, default=_DEFAULTS.clips, help="folder of the clips")
    parser.add_argument("--interval", type=float, default=5.0, help="seconds between cycles")
    parser.add_argument(
        "--planted", type=float, default=0.0, help="MB an hour that the page's daemon shall leak"
    )
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def measure() -> Measured:
        if not options.minutes >= _SHORTEST_MIN:
            raise InputError(
                "--minutes", f"{options.minutes:g} is too short", f"give {_SHORTEST_MIN:g} or more"
            )
        settings = SoakSettings(
            seconds=60 * options.minutes,
            out=options.out,
            clips=options.clips,
            interval_s=options.interval,
            planted_mb_per_h=options.planted,
        )
        with ProgressLine("soaking", sys.stderr) as progress:
            verdict = run_soak(settings, progress.update)
        colour = verdict.colour
        return Measured(settings.out, [Check("the soak", colour, "green", colour == "green")])

    return report("soak", measure, as_json=options.json)


if __name__ == "__main__":
    start(main)

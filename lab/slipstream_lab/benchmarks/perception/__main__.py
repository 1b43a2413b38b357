"""`python -m slipstream_lab.benchmarks.perception`: exit status 0 if all aims that were measured
are reached.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from slipstream.errors import InputError
from slipstream_lab.benchmarks.command import Measured, report, say, start
from slipstream_lab.benchmarks.perception.bench import PerceptionBenchSettings, run_bench
from slipstream_lab.benchmarks.perception.report import checks

_DEFAULTS = PerceptionBenchSettings()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.perception", description=__doc__
    )
    parser.add_argument("--minutes", type=float, default=10.0, help="two cameras live (default 10)")
    parser.add_argument(
        "--memory-minutes", type=float, default=30.0, help="a daemon at full speed (default 30)"
    )
    parser.add_argument(
        "--overload-seconds",
        type=float,
        default=_DEFAULTS.overload_s,
        help="two cameras beside a busy process (default 60)",
    )
    parser.add_argument("--rounds", type=int, default=_DEFAULTS.rounds)
    parser.add_argument("--frames", type=int, default=_DEFAULTS.frames, help="of ours in a round")
    parser.add_argument(
        "--peer", type=Path, default=_DEFAULTS.peer_python, help="a Python that has Ultralytics"
    )
    parser.add_argument("--clip", type=Path, default=_DEFAULTS.clip, help="folder of the clip")
    parser.add_argument("--out", type=Path, default=_DEFAULTS.out, help="folder for the report")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def measure() -> Measured:
        for name in ("rounds", "frames"):
            if getattr(options, name) < 1:
                raise InputError(f"--{name}", "is less than 1", "give 1 or more")
        settings = PerceptionBenchSettings(
            out=options.out,
            clip=options.clip,
            rounds=options.rounds,
            frames=options.frames,
            peer_python=options.peer,
            cameras_s=60 * options.minutes,
            overload_s=options.overload_seconds,
            memory_s=60 * options.memory_minutes,
        )
        # Peers that are not installed are no fault.
        return Measured(settings.out, checks(run_bench(settings, say)))

    return report("bench-perception", measure, as_json=options.json)


if __name__ == "__main__":
    start(main)

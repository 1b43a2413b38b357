"""`python -m slipstream_lab.benchmarks.chaos`: exit status 0 if nothing was lost, all was well in
time and no faulty camera's flag was shown, 1 otherwise.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream_lab.benchmarks.aims import Load, measured_on
from slipstream_lab.benchmarks.chaos import report as reports
from slipstream_lab.benchmarks.chaos.faults import SHARES
from slipstream_lab.benchmarks.chaos.run import run_chaos
from slipstream_lab.benchmarks.chaos.site import APART
from slipstream_lab.benchmarks.command import Measured, parts_of, report, say, start

_UNSHARE: Final = ("unshare", "--mount", "--net", "--pid", "--fork", "--kill-child", "--mount-proc")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the faults."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.chaos",
        description="Faults into the running daemons; red where anything is lost or late.",
    )
    parser.add_argument("--faults", type=int, default=200, help="how many (default 200)")
    parser.add_argument("--minutes", type=float, help="begin no fault after so long")
    parser.add_argument("--seed", type=int, default=1, help="of their order (default 1)")
    parser.add_argument("--only", help=f"kinds, separated by commas: {', '.join(SHARES)}")
    parser.add_argument(
        "--out", type=Path, default=Path(".slipstream/chaos"), help="report's folder"
    )
    parser.add_argument(
        "--clips", type=Path, default=Path(".slipstream/clips"), help="clips' folder"
    )
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def measure() -> Measured:
        if options.faults < 1:
            raise InputError("--faults", f"{options.faults} are none", "give 1 or more")
        kinds = parts_of(options.only, tuple(SHARES)) if options.only else ()
        until_s = time.monotonic() + 60 * options.minutes if options.minutes else float("inf")
        load = Load()
        result = run_chaos(
            options.out, options.clips, options.faults, options.seed, say, until_s, kinds
        )
        about = measured_on(
            load,
            seed=options.seed,
            cameras="5 pictures a second each",
            apart="namespaces of its own" if APART in os.environ else "none: see what is missing",
        )
        return reports.write(options.out, result, options.faults, about)

    return report("chaos", measure, as_json=options.json)


def _apart() -> None:
    """Begin again in namespaces of our own, where there may be any: cables and disks are ours
    then, and no process outlives us.
    """
    if APART in os.environ or shutil.which(_UNSHARE[0]) is None:
        return
    command = [*_UNSHARE, *(() if os.geteuid() == 0 else ("--map-root-user",))]
    if subprocess.run([*command, "true"], capture_output=True, check=False).returncode:
        return
    own = [sys.executable, "-m", "slipstream_lab.benchmarks.chaos", *sys.argv[1:]]
    os.execvpe(command[0], [*command, *own], {**os.environ, APART: "1"})


if __name__ == "__main__":
    _apart()
    start(main)

"""Base routes on published instances: VRPLIB's CVRP files and Solomon's text files.

python -m slipstream_lab.benchmarks.routing.published FILE ... [--rounds 15] [--iterations 16] [--seed 1]

The files are not part of the repository; they are read as `slipstream import` reads them.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Final

from dispatcher_daemon.settings import SearchSettings
from slipstream.files import ending_of
from slipstream_lab.benchmarks.routing.city_run import WORKERS
from slipstream_lab.research.instances.matrices import read_published, search_matrix_instance

_TIME_LIMIT_S: Final = 3600.0


def measure(path: Path, settings: SearchSettings, seed: int) -> str:
    """Search, and say what was found beside the best known where its file lies there too."""
    instance = read_published(path, "solomon" if ending_of(path) == ".txt" else "vrplib")
    used = _cpu_s()
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, spawn) as pool:
        plan = search_matrix_instance(instance, settings, pool, seed)
    total, best = plan.sums["distance"], instance.file.best_known
    text = f"{path.stem}, seed {seed}: {total:.1f}, {len(plan.unserved)} unserved"
    text += "".join(f", {fault}" for fault in plan.faults)
    gap = instance.gap(total)
    if best is not None:
        above = "not comparable with" if gap is None else f"{100 * gap:.2f} % above"
        text += f", {above} {best.cost:g}"
    return f"{text}; {_cpu_s() - used:.1f} CPU s in {plan.wall_s:.1f} s"


def _cpu_s() -> float:
    of = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(used.ru_utime + used.ru_stime for used in of)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure each file."""
    parser = argparse.ArgumentParser(prog="python -m slipstream_lab.benchmarks.routing.published")
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--rounds", type=int, default=SearchSettings().rounds)
    parser.add_argument("--iterations", type=int, default=SearchSettings().iterations_per_stop)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    settings = SearchSettings(
        rounds=options.rounds,
        iterations_per_stop=options.iterations,
        time_limit_s=_TIME_LIMIT_S,
    )
    for path in options.files:
        print(measure(path, settings, options.seed), flush=True)


if __name__ == "__main__":
    main()

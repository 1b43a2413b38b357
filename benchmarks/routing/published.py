"""Base routes on published instances: VRPLIB's CVRP files and Solomon's text files.

python -m benchmarks.routing.published FILE ... [--rounds 15] [--iterations 16] [--seed 1]

The files are not part of the repository. Vehicles are those that a file names, or a few more than
the k of an instance's name.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import resource
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import vrplib

from benchmarks.routing.city_run import WORKERS
from dispatcher_daemon.fleet import Depot, Fleet, Stop, Vehicle
from dispatcher_daemon.planning.base_routes import base_routes
from dispatcher_daemon.roads.weights import Floats
from dispatcher_daemon.settings import SearchSettings

_PER_KWH: Final = {"cvrp": 1000.0, "solomon": 100.0}
"""Units of distance that cost a kWh: totals like those of a city's fleet."""
_TIME_LIMIT_S: Final = 3600.0


def read(path: Path) -> tuple[Any, Any, Floats]:
    """(the problem, ways between its places, distances) as a search for base routes needs them.

    Distances are rounded for CVRP and cut to a tenth for Solomon's, as their best known are.
    """
    solomon = path.suffix == ".txt"
    found = vrplib.read_instance(
        path, "solomon" if solomon else "vrplib", compute_edge_weights=False
    )
    at = np.array(found["node_coord"], dtype=float)
    apart = np.linalg.norm(at[:, None] - at[None], axis=2)
    count = len(at)
    if solomon:
        distance = np.floor(10 * apart + 1e-9) / 10
        windows, service = found["time_window"].tolist(), found["service_time"].tolist()
        vehicles, back = int(found["vehicles"]), float(windows[0][1])
        duration, kind = distance, "solomon"
    else:
        distance, duration, kind = np.rint(apart), np.zeros((count, count)), "cvrp"
        windows, service, back = [(0.0, None)] * count, [0.0] * count, None
        vehicles = math.ceil(1.15 * int(path.stem.split("-k")[1])) + 1
    fleet = Fleet(
        depots=(Depot(id="depot", node="0"),),
        stops=tuple(
            Stop(
                id=str(i),
                node=str(i),
                service_s=service[i],
                demand=int(found["demand"][i]),
                earliest_s=windows[i][0],
                latest_s=windows[i][1],
            )
            for i in range(1, count)
        ),
        vehicles=tuple(
            Vehicle(id=f"v{n}", depot="depot", capacity=int(found["capacity"]), return_by_s=back)
            for n in range(vehicles)
        ),
    )
    travel = SimpleNamespace(
        row={"depot": 0, **{str(i): i for i in range(1, count)}},
        search_cost_kwh=distance / _PER_KWH[kind],
        duration_s=duration,
        of=lambda _: travel,
    )
    travel.by_profile = {None: travel}
    junctions = {str(i): tuple(at[i]) for i in range(count)}
    problem = SimpleNamespace(
        fleet=fleet, profile_of=lambda _: None, network=SimpleNamespace(junctions=junctions)
    )
    return problem, travel, distance


def measure(path: Path, settings: SearchSettings, seed: int) -> str:
    """Search, and say what was found beside the best known where its file lies there too."""
    problem, travel, distance = read(path)
    names = [stop.id for stop in problem.fleet.stops]
    began, used = time.perf_counter(), _cpu_s()
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, spawn) as pool:
        found = base_routes(problem, travel, names, settings, pool, seed)
    ways = [[0, *map(int, stops), 0] for stops in found.stops.values() if stops]
    total = sum(float(distance[a, b]) for way in ways for a, b in pairwise(way))
    text = f"{path.stem}, seed {seed}: {total:.1f}, {len(found.unassigned)} unserved"
    best = path.with_suffix(".sol")
    if best.exists():
        cost = float(vrplib.read_solution(best)["cost"])
        text += f", {100 * (total / cost - 1):.2f} % above {cost:g}"
    return f"{text}; {_cpu_s() - used:.1f} CPU s in {time.perf_counter() - began:.1f} s"


def _cpu_s() -> float:
    of = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(used.ru_utime + used.ru_stime for used in of)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure each file."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.routing.published")
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

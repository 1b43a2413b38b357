"""A cycle of a generated city on a cluster of this machine: time, plan and bytes sent.

python -m slipstream_lab.benchmarks.routing.cluster [--vehicles 200 --stops 1000 --segments 2000]
    [--deadline 28] [--workers 0 1 2] [--processes 1] [--seed 1] [--cycles 1]

One line of JSON for each number of workers; 0: this machine's processes without a cluster. With a
deadline that is not reached all plans are the same. `--deadline 300 --vehicles 1000 --stops 10000
--segments 20000` and then `--deadline 3000` show how far a large cycle is from a ten times longer
search.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from pathlib import Path

from dispatcher_daemon import metrics
from dispatcher_daemon.planning.route_form import FleetPlan, plan_fleet
from dispatcher_daemon.planning.routes import search_within
from dispatcher_daemon.settings import CitySettings, ClusterSettings, DispatcherSettings
from dispatcher_daemon.solvers import make_solver
from dispatcher_daemon.solvers.cluster import Cluster, ClusterExecutor, cluster_solve
from dispatcher_daemon.solvers.workers import Solve, SolverPool, WorkerExecutor
from slipstream.bus import free_port
from slipstream_lab.benchmarks.routing.city_run import unguarded
from slipstream_lab.research.cities.generator import generate_city
from slipstream_lab.research.instances.forms import instance_cycle

_READY_S = 300.0


@contextmanager
def members(workers: int, processes: int) -> Iterator[ClusterSettings]:
    """A scheduler and workers on loopback."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        address = f"tcp://127.0.0.1:{free_port()}"
        table = f'[cluster]\naddress = "{address}"\n[service]\nlog_level = "WARNING"\n'
        (folder / "scheduler.toml").write_text(table)
        (folder / "worker.toml").write_text(f"[worker]\nprocesses = {processes}\n{table}")
        for role in ("scheduler", *("worker" for _ in range(workers))):
            process = subprocess.Popen(
                [sys.executable, "-m", "slipstream_cli", role, "--config", folder / f"{role}.toml"]
            )
            stack.callback(process.wait, 60)
            stack.callback(process.terminate)
        yield ClusterSettings(address=address)


@contextmanager
def solving(
    settings: CitySettings, workers: int, processes: int
) -> Iterator[tuple[Executor, Solve]]:
    """What a dispatcher solves with, warm."""
    solvers = [make_solver(name, DispatcherSettings()) for name in settings.solvers]
    count = settings.search.workers
    with SolverPool(solvers, count) as pool, WorkerExecutor(count) as own, ExitStack() as stack:
        pool.warm_up()
        if not workers:
            yield own, pool
            return
        cluster = Cluster(
            stack.enter_context(members(workers, processes)), count, solvers, (search_within,)
        )
        executor = stack.enter_context(ClusterExecutor(cluster, own, count))
        if not cluster.wait_for(workers * processes, _READY_S):
            raise TimeoutError("the workers are not ready")
        yield executor, cluster_solve(cluster, solvers, pool)


def figures(made: FleetPlan, wall_s: float) -> dict[str, object]:
    """Of one cycle."""
    visits = repr([(i.stops, i.depart_s) for i in made.choice.itineraries])
    return {
        "wall_s": round(wall_s, 1),
        "timed_out": made.timed_out,
        "objective_kwh": made.choice.objective_kwh,
        "unserved": len(made.unserved),
        "plan": sha256(visits.encode()).hexdigest()[:12],
        "stages_s": {name: round(seconds, 1) for name, seconds in made.wall_s.items()},
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cycles."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, default in (("vehicles", 200), ("stops", 1000), ("segments", 2000), ("seed", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--deadline", type=float, default=28.0, help="of a cycle, s")
    parser.add_argument("--workers", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--processes", type=int, default=1, help="of each worker")
    parser.add_argument("--cycles", type=int, default=1, help="repetitions of the same cycle")
    options = parser.parse_args(arguments)
    size = {name: getattr(options, name) for name in ("vehicles", "stops", "segments")}
    for run in runs(
        options.seed, options.deadline, options.workers, options.processes, options.cycles, **size
    ):
        print(json.dumps(run), flush=True)
    return 0


def runs(
    seed: int,
    deadline_s: float,
    all_workers: Sequence[int],
    processes: int,
    cycles: int,
    *,
    vehicles: int,
    stops: int,
    segments: int,
) -> Iterator[dict[str, object]]:
    """The same cycle of a generated city, so many times for each number of workers."""
    city = generate_city(seed, vehicles=vehicles, stops=stops, segments=segments)
    settings = unguarded(deadline_s)
    cycle = instance_cycle(
        city,
        seed,
        DispatcherSettings(
            city=settings,
            solvers=settings.solvers,
            deadline_s=deadline_s,
            interval_s=2 * deadline_s,
        ),
    )
    for workers in all_workers:
        with solving(settings, workers, processes) as (executor, solve):
            for number in range(cycles):
                before, began = _metrics(), time.monotonic()
                made = plan_fleet(cycle, executor, solve)
                wall_s = time.monotonic() - began
                used = {name: value - before[name] for name, value in _metrics().items()}
                yield {"workers": workers, "cycle": number, **figures(made, wall_s), **used}


def _metrics() -> dict[str, float]:
    """Bytes sent to the cluster, and its calls by how they ended."""
    samples = [
        sample
        for metric in (metrics.CLUSTER_BYTES, metrics.CLUSTER_CALLS)
        for family in metric.collect()
        for sample in family.samples
        if sample.name.endswith("_total")
    ]
    found = dict.fromkeys(("value", "lost", "late", "raised", "bytes"), 0.0)
    return found | {s.labels.get("result", "bytes"): s.value for s in samples}


if __name__ == "__main__":
    sys.exit(main())

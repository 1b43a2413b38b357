"""`python -m benchmarks.orders`: orders submitted to a city's dispatcher while a cycle runs, and
between two cycles.

With the store and the processes of a dispatcher, without HTTP and bus. Vehicles never report, so
that a tour is open until its departure.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dispatcher_daemon.dispatcher import Dispatcher
from dispatcher_daemon.intake import OrderIntake
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.execution.pool import SolverPool
from dispatcher_daemon.solvers.execution.processes import WorkerExecutor
from dispatcher_daemon.solvers.registry import configured_solvers
from research.cities.generator import generate_city
from slipstream.messages import Message, OrderRequest, VehiclePlan
from storage import open_database, open_reader


@dataclass
class _Bus:
    """Notes when each order was in a plan first."""

    placed: dict[str, float] = field(default_factory=dict)

    def publisher(self, key: str) -> _Bus:
        return self

    def put(self, message: Message | bytes) -> None:
        if isinstance(message, VehiclePlan):
            now = time.perf_counter()
            for stop in message.service_stops:
                self.placed.setdefault(stop.stop, now)


def main() -> None:
    """Print the percentiles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=200)
    parser.add_argument("--stops", type=int, default=1000)
    parser.add_argument("--orders", type=int, default=100, help="of each part")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    city = generate_city(options.seed, vehicles=options.vehicles, stops=options.stops)
    problem, rng = city.problem, np.random.default_rng(options.seed)
    nodes = sorted({stop.node for stop in problem.fleet.stops})

    def request(name: str) -> OrderRequest:
        return OrderRequest(id=name, node=str(rng.choice(nodes)), demand=1)

    settings = DispatcherSettings(form="route", deadline_s=20.0)
    executor = WorkerExecutor(settings.city.search.workers)
    parallel = dict.fromkeys(settings.city.solvers, settings.city.search.workers)
    with (
        tempfile.TemporaryDirectory() as folder,
        SolverPool(configured_solvers(settings), parallel) as pool,
        executor,
    ):
        pool.warm_up(stopping=threading.Event())
        url, bus = f"sqlite:///{folder}/a.db", _Bus()
        with open_database(url) as database, open_reader(url) as reader:
            network = problem.network
            dispatcher = Dispatcher(settings, network, problem.fleet, bus, database, pool, executor)
            intake = OrderIntake(dispatcher.fleet_watch, database, reader, network)
            intake.submit([request("warm")])

            def acknowledged(names: Sequence[str], pause_s: float, insert: bool) -> list[float]:
                """Seconds until each order is acknowledged."""
                found = []
                for name in names:
                    order, began = request(name), time.perf_counter()
                    intake.submit([order])
                    found.append(time.perf_counter() - began)
                    sent[name] = began
                    if insert:
                        dispatcher.insert([name])
                    time.sleep(pause_s)
                return found

            sent: dict[str, float] = {}
            cycle = threading.Thread(target=dispatcher.run_cycle)
            cycle.start()
            names = [f"in-{n}" for n in range(options.orders)]
            during = acknowledged(names, 10.0 / options.orders, False)
            print(f"cycle still running after the last of them: {cycle.is_alive()}")
            cycle.join()
            names = [f"between-{n}" for n in range(options.orders)]
            between = acknowledged(names, 0.0, True)
            placed = [bus.placed[name] - sent[name] for name in names if name in bus.placed]
    _print("acknowledged during a cycle", during)
    _print("acknowledged between cycles", between)
    _print(f"in a plan between cycles ({len(placed)} of {len(names)} placed)", placed)


def _print(what: str, seconds: Sequence[float]) -> None:
    if seconds:
        p50, p95, p99 = np.percentile(1e3 * np.array(seconds), (50, 95, 99))
        print(f"{what}: {p50:.0f} ms (median), {p95:.0f} ms (p95), {p99:.0f} ms (p99)")


if __name__ == "__main__":
    main()

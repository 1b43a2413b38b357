"""`python -m slipstream_lab.benchmarks.orders`: orders submitted to a city's dispatcher while a
cycle runs, and between two cycles.

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

from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.service.intake import OrderIntake
from dispatcher_daemon.settings import DispatcherSettings, OrderSettings
from dispatcher_daemon.solvers import configured_solvers
from dispatcher_daemon.solvers.workers import SolverPool, WorkerExecutor
from slipstream.messages import Message, OrderRequest, VehiclePlan
from slipstream_lab.research.cities.generator import generate_city
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


@dataclass(frozen=True)
class InsertionFigures:
    """What was measured, s of each order."""

    during: Sequence[float]
    between: Sequence[float]
    placed: Sequence[float]
    ran: bool


def main() -> None:
    """Print the percentiles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=200)
    parser.add_argument("--stops", type=int, default=1000)
    parser.add_argument("--orders", type=int, default=100, help="of each part")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    found = measure(options.vehicles, options.stops, options.orders, options.seed)
    print(f"cycle still running after the last of them: {found.ran}")
    _print("acknowledged during a cycle", found.during)
    _print("acknowledged between cycles", found.between)
    what = f"in a plan between cycles ({len(found.placed)} of {len(found.between)} placed)"
    _print(what, found.placed)


def measure(vehicles: int, stops: int, orders: int, seed: int) -> InsertionFigures:
    """Submit so many orders during a cycle of a generated city, and as many after it."""
    city = generate_city(seed, vehicles=vehicles, stops=stops)
    problem, rng = city.problem, np.random.default_rng(seed)
    nodes = sorted({stop.node for stop in problem.fleet.stops})

    def request(name: str) -> OrderRequest:
        return OrderRequest(id=name, node=str(rng.choice(nodes)), demand=1)

    settings = DispatcherSettings(form="route", deadline_s=20.0, orders=OrderSettings(bundle_s=0.0))
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
            names = [f"in-{n}" for n in range(orders)]
            during = acknowledged(names, 10.0 / orders, False)
            ran = cycle.is_alive()
            cycle.join()
            names = [f"between-{n}" for n in range(orders)]
            between = acknowledged(names, 0.0, True)
            placed = [bus.placed[name] - sent[name] for name in names if name in bus.placed]
    return InsertionFigures(during, between, placed, ran)


def _print(what: str, seconds: Sequence[float]) -> None:
    if seconds:
        p50, p95, p99 = np.percentile(1e3 * np.array(seconds), (50, 95, 99))
        print(f"{what}: {p50:.0f} ms (median), {p95:.0f} ms (p95), {p99:.0f} ms (p99)")


if __name__ == "__main__":
    main()

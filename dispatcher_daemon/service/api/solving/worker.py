"""What the worker process of jobs runs: one cycle's planning of a caller's fleet."""

from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

from pydantic import BaseModel, Field

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.fleet.learning import Learned
from dispatcher_daemon.forms import routing_problem
from dispatcher_daemon.planning.cycle import cycle_of, run_cycle
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers import configured_solvers
from dispatcher_daemon.solvers.workers import executor_solve
from dispatcher_daemon.traffic import Expectations, TrafficSnapshot, traffic_by
from slipstream.errors import InputError
from slipstream.messages import CycleReport, SegmentState, VehiclePlan
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network


@dataclass(frozen=True)
class RoadTask:
    """What a worker needs of the dispatcher; it can be pickled.

    Attributes:
        roads: `fingerprint` of the dispatcher's network, which the worker reads anew.
    """

    settings: DispatcherSettings
    roads: str
    states: tuple[SegmentState, ...]
    learned: Learned
    now_ns: int
    seed: int

    def traffic(self) -> tuple[RoadNetwork, TrafficSnapshot]:
        """The dispatcher's roads, and their traffic at the task's moment.

        Raises:
            InputError: the network's file has changed since the dispatcher read it.
        """
        network, found = _network(self.settings.network)
        if found != self.roads:
            _network.cache_clear()
            problem = "the file has changed since the dispatcher read it"
            raise InputError(self.settings.network, problem, "restart the dispatcher")
        snapshot = traffic_by(self.settings, network, self.states, self.now_ns)
        return network, self.learned.onto(snapshot)


@dataclass(frozen=True)
class SolveTask(RoadTask):
    """A fleet to plan, by settings with the caller's deadline."""

    fleet: Fleet

    def __call__(self) -> bytes:
        """Plan the fleet; a `SolveResult` as JSON.

        Raises:
            InputError: the network's file has changed since the dispatcher read it, or the settings
                do not fit the fleet.
        """
        settings = self.settings
        network, snapshot = self.traffic()
        problem = routing_problem(network, self.fleet, settings)
        cycle = cycle_of(problem, snapshot, settings, seed=self.seed)
        solvers = configured_solvers(settings)
        for solver in solvers:
            solver.warm_up()
        threads = ThreadPoolExecutor(len(solvers))
        try:
            result = run_cycle(cycle, executor_solve(threads, solvers, workers=len(solvers)))
        finally:
            # One that overruns its deadline is not waited for.
            threads.shutdown(wait=False, cancel_futures=True)
        answer = SolveResult(report=result.report, plans=list(result.plans))
        return answer.model_dump_json().encode()


class SolveResult(BaseModel):
    """What a cycle with this fleet would report and publish."""

    report: CycleReport = Field(description="Its number is 0: it is none of the dispatcher's.")
    plans: list[VehiclePlan]


def fingerprint(network: RoadNetwork) -> str:
    """What tells one road network from another."""
    digest = hashlib.sha256()
    for name in sorted(network.segments):
        s = network.segments[name]
        turns = sorted(network.turns(name))
        parts = (s.id, s.start, s.end, s.length_m, s.speed_limit_mps, turns)
        digest.update(repr(parts).encode())
    return digest.hexdigest()


def picklable(learned: Learned) -> Learned:
    """The same in plain dictionaries."""
    found = learned.expected
    if found is None:
        return Learned(dict(learned.usual_mps), dict(learned.open_shares), None)
    plain = Expectations(dict(found.loss_kwh), dict(found.seconds), dict(found.stops))
    return Learned(dict(learned.usual_mps), dict(learned.open_shares), plain)


@lru_cache(maxsize=1)
def _network(reference: str) -> tuple[RoadNetwork, str]:
    network = load_network(reference)
    return network, fingerprint(network)

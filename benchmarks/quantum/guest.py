"""`python -m benchmarks.quantum.guest`: dispatch cycles beside a device that fails in every way.

Real cycles, workers, database and desk; the device's service is a stand-in that times out, refuses,
loses jobs, answers garbage, late or never, hangs and takes the worker down with it. Every few
cycles desk and database are torn down, whatever they are at, and opened again. Exit status 1 if
any promise is broken.
"""

from __future__ import annotations

import argparse
import json
import logging
import random
import statistics
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import psutil

from benchmarks.quantum.ansatz_maker import AnsatzMaker
from benchmarks.quantum.faulty_service import EVERYTHING, Books, Opening
from dispatcher_daemon.dispatch import run_cycle
from dispatcher_daemon.fleet import load_fleet
from dispatcher_daemon.guest.clerk import Clerk
from dispatcher_daemon.guest.desk import Desk
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.settings import DispatcherSettings, HardwareSettings, LcQaoaSettings
from dispatcher_daemon.solvers.base import Outcome
from dispatcher_daemon.solvers.lc_qaoa import LcQaoaSolver
from dispatcher_daemon.solvers.pool import GRACE_S, Job, Solve, SolverPool
from dispatcher_daemon.solvers.registry import configured_solvers
from dispatcher_daemon.traffic import SegmentTraffic, TrafficSnapshot
from dispatcher_daemon.verify import verify_plans
from slipstream.roads import load_network
from storage import QuantumJob, open_database, open_reader

OVERHEAD_S: Final = 1.0
"""What a cycle does beside solving: building, verifying, on a machine that others use too."""
DESK_S: Final = 0.25
"""What the desk may take beside what is waited for: the pool, and the deadline."""
DAY_S: Final = 30.0
"""The budget's day here, so that many of them pass."""

SETTINGS: Final = DispatcherSettings(
    solvers=("exact", "lc-qaoa"),
    deadline_s=0.4,
    interval_s=0.8,
    lc_qaoa=LcQaoaSettings(variant="ramp", shots=128),
    hardware=HardwareSettings(
        backend="ibm:faulty",
        shots=256,
        budget_s_per_day=40.0,
        most_pending=3,
        wait_s=0.4,
        poll_s=0.05,
        most_poll_s=0.5,
        call_limit_s=0.5,
        give_up_after_s=5.0,
        lost_after_s=1.0,
        faults=4,
        rest_s=0.3,
        most_rest_s=1.5,
    ),
)


@dataclass
class Run:
    """What came of it.

    Attributes:
        cycles: that were run.
        restarts: of desk and database in between.
        answered: cycles by where the circuit's answer came from.
        fallbacks: reasons, their figures left out, by how often.
        walls_s: time of each cycle from the call to the verified plan.
        beyond_s: time that the desk took in each cycle beyond the deadline, or beyond the pool's
            answers where these came after it.
        events: what the service did, by how often.
        jobs: of the ledger at the end, by state.
        answers: what became of the answers.
        charged_s: device time that the service charged in all.
        most_in_a_day_s: the most of it in any window of the budget's length.
        budget_s: what was allowed.
        limit_s: on the time of a cycle: its deadline, the pool's grace and what is around them.
        growth: threads, processes, descriptors in the last cycle less those in the first ones.
        leaks: the same after all is closed, less before all was opened.
        broken: promises that were not kept; empty if all is well.
    """

    cycles: int = 0
    restarts: int = 0
    answered: Counter[str] = field(default_factory=Counter)
    fallbacks: Counter[str] = field(default_factory=Counter)
    walls_s: list[float] = field(default_factory=list)
    beyond_s: list[float] = field(default_factory=list)
    events: dict[str, int] = field(default_factory=dict)
    jobs: dict[str, int] = field(default_factory=dict)
    answers: dict[str, int] = field(default_factory=dict)
    charged_s: float = 0.0
    most_in_a_day_s: float = 0.0
    budget_s: float = 0.0
    limit_s: float = 0.0
    growth: dict[str, int] = field(default_factory=dict)
    leaks: dict[str, int] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)

    def report(self) -> dict[str, Any]:
        """All of it for JSON, times as percentiles."""
        figures = dict(vars(self))
        del figures["walls_s"], figures["limit_s"], figures["beyond_s"]
        figures["wall_s"] = _spread(self.walls_s) | {"limit": self.limit_s}
        figures["desk_beyond_s"] = _spread(self.beyond_s) | {"limit": DESK_S}
        return figures


def _spread(times_s: Sequence[float]) -> dict[str, float]:
    ordered = sorted(times_s)
    return {
        "median": round(statistics.median(ordered), 3),
        "p99": round(ordered[int(0.99 * (len(ordered) - 1))], 3),
        "max": round(ordered[-1], 3),
    }


class Timed:
    """A `Solve` that knows how long its last call took, and whether a solver was too late in it.

    Args:
        solve: what is timed.
    """

    def __init__(self, solve: Solve) -> None:
        self._solve = solve
        self.wall_s = 0.0
        self.late = False

    def __call__(self, jobs: Sequence[Job], deadline_s: float) -> list[Outcome]:
        """See `Solve`."""
        began = time.monotonic()
        outcomes = self._solve(jobs, deadline_s)
        self.wall_s = time.monotonic() - began
        self.late = any(outcome.status == "timeout" for outcome in outcomes)
        return outcomes


class Stage:
    """Everything around the cycles; desk and database can be torn down and opened again."""

    def __init__(
        self, folder: Path, seed: int, settings: DispatcherSettings, solve: Solve | None
    ) -> None:
        self.settings = settings
        self.url = f"sqlite:///{folder}/cycles.db"
        self.books = Books(folder / "service.db", seed, EVERYTHING, (0.0, 0.25))
        self._pool = None
        if solve is None:
            solve = self._pool = SolverPool(configured_solvers(settings))
            self._pool.warm_up()
        self.inner = Timed(solve)
        network = load_network("demo")
        self.problem = RoutingProblem(network, load_fleet("demo", network))
        self._stack = ExitStack()
        self.open(warm=True)

    def open(self, *, warm: bool) -> None:
        """Database and desk.

        Args:
            warm: whether to wait for the device's worker, so that the next cycles meet the device.
        """
        self.database = self._stack.enter_context(open_database(self.url))
        hardware = self.settings.hardware
        clerk = Clerk(
            hardware,
            "hardware",
            Opening(str(self.books.path)),
            AnsatzMaker(LcQaoaSolver(self.settings.lc_qaoa)),
            self.database,
            day_s=DAY_S,
        )
        self.desk = self._stack.enter_context(Desk(self.inner, clerk, hardware.wait_s))
        if warm:
            clerk.warm.wait(60.0)

    def rest(self) -> None:
        """Between cycles: a killed solver's successor gets time to start, as it has in service.

        A cycle here is shorter than importing Aer takes, and would kill each successor in turn.
        """
        if self.inner.late and self._pool is not None:
            self._pool.warm_up(30.0)

    def tear_down(self) -> None:
        """As a crash would: nothing is finished, nothing is told."""
        self._stack.close()

    def close(self) -> None:
        """All of it."""
        self.tear_down()
        if self._pool is not None:
            self._pool.close()


def run(
    cycles: int,
    seed: int,
    folder: Path,
    *,
    settings: DispatcherSettings = SETTINGS,
    solve: Solve | None = None,
    restart_every: int = 40,
    tell: Callable[[str], None] = lambda _: None,
) -> Run:
    """Run the cycles and judge them.

    Args:
        folder: for database and service.
        solve: in place of a pool of the settings' solvers.
        restart_every: cycles between two restarts, on average.
        tell: takes a line now and then.
    """
    limit_s = settings.deadline_s + GRACE_S + OVERHEAD_S
    result = Run(budget_s=settings.hardware.budget_s_per_day, limit_s=limit_s)
    rng = random.Random(seed)
    before = _resources()
    stage = Stage(folder, seed, settings, solve)
    early = before
    try:
        for number in range(1, cycles + 1):
            _cycle(stage, number, rng, result)
            if rng.random() * restart_every < 1:
                stage.tear_down()
                stage.open(warm=rng.random() < 0.5)
                result.restarts += 1
            if number == min(20, cycles):
                early = _resources()
            if number % 50 == 0:
                tell(f"{number} cycles, {dict(result.answered)}, broken: {result.broken[-3:]}")
        _settle(stage, result)
        late = _resources()
    finally:
        stage.close()
    _judge(stage.books, stage.url, result)
    after = _resources()
    result.growth = {name: late[name] - early[name] for name in early}
    result.leaks = {name: after[name] - before[name] for name in before}
    # A worker may just be replaced, and the first pool leaves multiprocessing's resource tracker.
    for name, most in (("threads", 2), ("processes", 1), ("descriptors", 6)):
        for what, figures in (("in the run", result.growth), ("after it", result.leaks)):
            if figures[name] > most:
                result.broken.append(f"{figures[name]} more {name} {what}")
    return result


def _cycle(stage: Stage, number: int, rng: random.Random, result: Run) -> None:
    snapshot = _traffic(stage.problem, rng)
    stage.desk.begin_cycle(number)
    outer = Timed(stage.desk)
    began = time.monotonic()
    done = run_cycle(
        stage.problem, snapshot, stage.settings, outer, snapshot.now_ns, number, seed=number
    )
    wall_s = time.monotonic() - began
    beyond_s = outer.wall_s - max(stage.inner.wall_s, stage.settings.deadline_s)
    result.beyond_s.append(max(0.0, beyond_s))
    if beyond_s > DESK_S:
        result.broken.append(f"cycle {number}: the desk took {beyond_s:.2f} s more")
    result.cycles += 1
    result.walls_s.append(wall_s)
    if wall_s > result.limit_s:
        result.broken.append(
            f"cycle {number} took {wall_s:.2f} s, {outer.wall_s:.2f} s of it to solve, "
            f"the pool {stage.inner.wall_s:.2f} s"
        )
    if not done.plans:
        result.broken.append(f"cycle {number} made no plan: {done.report.reason}")
    faults = verify_plans(
        done.plans,
        stage.problem.network,
        stage.problem.fleet,
        {name for name, traffic in snapshot.segments.items() if traffic.open},
        stage.settings.sync_window_s,
        unserved={},
        reference_s=stage.settings.deadline_s,
    )
    result.broken += [f"cycle {number}: {fault}" for fault in faults]
    stage.database.record_cycle(done.report, done.plans, snapshot.states)
    stage.rest()
    (chain,) = (run for run in done.report.solvers if run.solver == "lc-qaoa")
    result.answered[chain.backend_kind or f"none: {chain.status}"] += 1
    if chain.backend_kind != "hardware":
        why = chain.fallback or chain.reason or ""
        if not why:
            result.broken.append(f"cycle {number} does not say why the device has not answered")
        result.fallbacks[_kind_of(why)] += 1


def _traffic(problem: RoutingProblem, rng: random.Random) -> TrafficSnapshot:
    """Gates open and close, speeds go up and down: now and then other arcs are candidates."""
    seen = {}
    for name in ("avenue_east", "avenue_west"):
        limit = problem.network.segments[name].speed_limit_mps
        calm = rng.random() < 0.7
        speed = limit * (rng.choice((0.9, 1.0)) if calm else rng.choice((0.3, 0.5)))
        seen[name] = SegmentTraffic(name, speed, y_e=int(calm), open=calm, reason=None, age_s=1.0)
    segments = {
        s: SegmentTraffic(s, r.speed_limit_mps) for s, r in problem.network.segments.items()
    }
    return TrafficSnapshot(time.time_ns(), segments | seen, ())


def _settle(stage: Stage, result: Run) -> None:
    """Without new faults all jobs must come to an end by themselves."""
    stage.books.expect({})
    limits = stage.settings.hardware
    until = time.monotonic() + limits.give_up_after_s + limits.lost_after_s + 20.0
    while stage.desk.health().pending and time.monotonic() < until:
        time.sleep(0.1)
    if stage.desk.health().pending:
        result.broken.append(f"{stage.desk.health().pending} jobs never came to an end")


def _judge(books: Books, url: str, result: Run) -> None:
    """The ledger against the service's own books, and against the cycles."""
    now = time.time()
    with open_reader(url) as reader:
        ledger = {job.tag: job for job in reader.jobs(limit=10**6)}
        reports = reader.cycles(limit=10**6)
    taken = {job["tag"]: job for job in books.jobs()}
    result.events = dict(books.happened())
    result.jobs = dict(Counter(job.state for job in ledger.values()))
    result.answers = dict(Counter(job.answer or "none" for job in ledger.values()))
    charges = books.charges(now)
    result.charged_s = sum(usage for _, usage in charges)
    result.most_in_a_day_s = books.most_in_a_day(now, DAY_S)
    if result.most_in_a_day_s > result.budget_s:
        result.broken.append(f"{result.most_in_a_day_s:.1f} s charged in one window of the budget")
    if len(taken) < len(books.jobs()):
        result.broken.append("a job was submitted twice")
    for tag, theirs in taken.items():
        result.broken += _differences(ledger.get(tag), theirs, now)
    used = Counter(job.answer_cycle for job in ledger.values() if job.answer == "used")
    shown = Counter(
        report.cycle
        for report in reports
        for run in report.solvers
        if run.backend_kind == "hardware"
    )
    # A desk torn down between an answer and its entry leaves the entry out; never the answer.
    if used - shown or len(shown - used) > result.restarts:
        result.broken.append(f"used: {used - shown} unseen, {shown - used} not entered")


def _differences(ours: QuantumJob | None, theirs: dict[str, Any], now: float) -> list[str]:
    """What the ledger says of a job that the service knows otherwise."""
    if ours is None:
        return [f"{theirs['tag']} is in no ledger"]
    wrong = []
    if ours.job_id not in (None, theirs["id"]):
        wrong.append(f"{ours.tag} has the id of another job")
    if ours.open:
        wrong.append(f"{ours.tag} is open at the end")
    gone = theirs["cancelled"] or theirs["fate"] == "never" or theirs["ready"] > now
    charged = 0.0 if gone else theirs["usage"]
    counted = ours.estimate_s if ours.usage_s is None else ours.usage_s
    if counted < charged - 1e-9:
        wrong.append(f"{ours.tag} counts {counted:.2f} s, {charged:.2f} s were charged")
    if ours.answer == "used" and theirs["fate"] not in ("ok", "late", "usage unknown"):
        wrong.append(f"the answer of {ours.tag} was used though it was: {theirs['fate']}")
    return wrong


def _kind_of(why: str) -> str:
    """A reason without its figures and names."""
    words = ("#" if any(c.isdigit() for c in word) else word for word in why.split())
    return " ".join(words)[:90]


def _resources() -> dict[str, int]:
    process = psutil.Process()
    return {
        "threads": threading.active_count(),
        "processes": len(process.children(recursive=True)),
        "descriptors": process.num_fds(),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it and print the figures as JSON."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.quantum.guest", description=__doc__)
    parser.add_argument("--cycles", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="kept afterwards (default: a temporary one)")
    options = parser.parse_args(arguments)
    logging.disable(logging.CRITICAL)
    with ExitStack() as stack:
        folder = options.folder
        if folder is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        began = time.monotonic()
        result = run(
            options.cycles,
            options.seed,
            folder,
            tell=lambda line: print(line, file=sys.stderr, flush=True),
        )
        report = result.report() | {"took_s": round(time.monotonic() - began, 1)}
    print(json.dumps(report, indent=1))
    return 1 if result.broken else 0


if __name__ == "__main__":
    sys.exit(main())

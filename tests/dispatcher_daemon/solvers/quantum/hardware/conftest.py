"""A device's service that does as it is told, and a runner with a clock of our own."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest

from dispatcher_daemon.forms.problem import ArcProblem, CandidateArc, Problem
from dispatcher_daemon.settings import HardwareSettings
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.quantum.backends.jobs import JobView, ServiceFault
from dispatcher_daemon.solvers.quantum.hardware.breaker import CircuitBreaker, JobLimits
from dispatcher_daemon.solvers.quantum.hardware.circuits import (
    BuiltCircuit,
    Unsuitable,
    problem_key,
)
from dispatcher_daemon.solvers.quantum.hardware.ledger import Ledger
from dispatcher_daemon.solvers.quantum.hardware.request import JobRequest
from dispatcher_daemon.solvers.quantum.hardware.runner import JobRunner
from dispatcher_daemon.solvers.quantum.lc_qaoa import Place
from storage import QuantumJob, StorageError

SHOTS = 8
SAMPLES = {"01": 5, "10": 3}
SETTINGS = HardwareSettings(
    backend="ibm:toy",
    shots=SHOTS,
    budget_s_per_day=10.0,
    max_pending_jobs=2,
    jobs_per_cycle=9,
)
LIMITS = JobLimits(max_poll_s=8.0, job_timeout_s=100.0, lost_after_s=20.0)


def toy_problem(*stops: str) -> ArcProblem:
    """A van from the depot to one of these stops."""
    return ArcProblem("d", stops, ("v",), tuple(CandidateArc("v", "d", s, 1.0) for s in stops))


@dataclass(frozen=True)
class ToyBuilder:
    """Two qubits a problem; valid if any sample is."""

    name: str = "lc-qaoa"
    encoding: str = "toy"

    def warm_up(self) -> None:
        """Nothing to import."""

    def build(
        self, problem: Problem, deadline_s: float, seed: int, place: Place | None = None
    ) -> BuiltCircuit:
        """No training."""
        if not problem.choices:
            raise Unsuitable("nothing to choose")
        return BuiltCircuit("circuit", (1, 0), "f" * 16, "ramp", 2, 0.25)

    def decode(
        self, problem: Problem, order: Sequence[int], samples: Mapping[str, int], seed: int
    ) -> Outcome:
        """The first arc, unless every sample is 00."""
        if set(samples) == {"00"}:
            return Outcome(self.name, "failed", None, 0.0, reason="no sample led to a route")
        return Outcome(self.name, "feasible", frozenset({0}), 0.0)


@dataclass(eq=False)
class ToyService:
    """Each call does what was put into its list, or goes well."""

    name: str = "toy"
    submits: list[Any] = field(default_factory=list)
    looks: list[Any] = field(default_factory=list)
    finds: list[Any] = field(default_factory=list)
    cancels: list[Any] = field(default_factory=list)
    opens: list[Any] = field(default_factory=list)
    jobs: dict[str, str] = field(default_factory=dict)
    made: int = 0
    cancelled: list[str] = field(default_factory=list)
    max_age_s: float = math.inf
    opened: int = 0
    asked: list[bool] = field(default_factory=list)

    def __call__(self) -> ToyService:
        """Open it."""
        self.opened += 1
        _next(self.opens, None)
        return self

    def estimate_s(self, circuit: object, shots: int) -> float:
        """Each job is said to take 4 s."""
        return 4.0

    def place(self, n: int, bond_weights: object = None) -> None:
        """Not asked."""

    def two_qubit(self, circuit: object) -> tuple[int, int]:
        """Any depth and number of gates."""
        return 4, 2

    def submit(self, circuit: object, shots: int, tags: Sequence[str]) -> Any:
        """Take the job, unless told not to; then do as told."""
        told = _next(self.submits, "taken", peek=True)
        job_id = f"job-{self.made + 1}"
        if told == "taken" or (isinstance(told, tuple) and told[0] == "taken but"):
            self.made += 1
            self.jobs[job_id] = tags[0]
        if isinstance(told, tuple):
            told = told[1]
        if isinstance(told, BaseException):
            raise told
        return job_id if told == "taken" else told

    def look(self, job_id: str, *, samples: bool = True) -> Any:
        """Queued, unless told otherwise; whether samples were asked for is written down."""
        self.asked.append(samples)
        return _next(self.looks, JobView("queued"))

    def cancel(self, job_id: str) -> None:
        """Cancel."""
        _next(self.cancels, None)
        self.cancelled.append(job_id)

    def find(self, tag: str) -> Any:
        """By tag."""
        return _next(self.finds, [i for i, t in self.jobs.items() if t == tag])


def _next(told: list[Any], otherwise: Any, *, peek: bool = False) -> Any:
    value = told.pop(0) if told else otherwise
    if isinstance(value, BaseException) and not peek:
        raise value
    return value


class ToyStore:
    """A database in memory."""

    def __init__(self) -> None:
        self.rows: dict[str, QuantumJob] = {}
        self.broken = False
        self.saved: list[QuantumJob] = []

    def save_job(self, job: QuantumJob) -> None:
        """Store, or fail as a full disk does."""
        if self.broken:
            raise StorageError("x.db: disk full")
        self.rows[job.tag] = job
        self.saved.append(job)

    def jobs_since(self, finished_ns: int) -> list[QuantumJob]:
        """All that are open or over since."""
        return [j for j in self.rows.values() if j.open or (j.finished_ns or 0) >= finished_ns]


class RunnerHarness:
    """A runner with a clock, a service and a store; the first two survive its restart."""

    def __init__(self, settings: HardwareSettings = SETTINGS) -> None:
        self.now_s = 1000.0
        self.settings = settings
        self.service, self.store, self.builder = ToyService(), ToyStore(), ToyBuilder()
        self.cycle = 0
        self.restart()

    def restart(self) -> None:
        """A new runner, as after a crash: only service and store know what was."""
        self.ledger = Ledger(self.store, "hardware", self.now_ns)
        self.breaker = CircuitBreaker(LIMITS, lambda: self.now_s)
        self.runner = JobRunner(
            self.settings,
            LIMITS,
            "hardware",
            self.service,
            self.builder,
            self.ledger,
            self.breaker,
            self.call,
            self.now_ns,
            lambda: self.now_s,
        )

    def now_ns(self) -> int:
        """UTC."""
        return int(self.now_s * 1e9)

    def call(self, function: Callable[..., Any], args: Sequence[Any], timeout_s: float) -> Any:
        """Here, with the faults of a worker turned as `ServiceWorker.call` does."""
        try:
            return function(*args)
        except (ServiceFault, Unsuitable):
            raise
        except Exception as error:
            raise ServiceFault("broken", str(error)) from None

    def request(self, *stops: str) -> JobRequest:
        """A new cycle's request for a problem with these stops, not served yet."""
        self.cycle += 1
        problem = toy_problem(*stops or ("a", "b"))
        ends_at = self.now_s + 10.0
        key = problem_key(problem, "toy")
        return JobRequest(problem, key, 1, self.cycle, ends_at, lambda: self.now_s)

    def ask(self, *stops: str) -> JobRequest:
        """A new cycle asks."""
        request = self.request(*stops)
        self.runner.begin_cycle()
        self.runner.serve(request)
        return request

    def wait(self, seconds: float) -> None:
        """Time goes by, and every poll that is due is done."""
        until = self.now_s + seconds
        while (due := self.runner.next_poll()) is not None and due[0] <= until:
            self.now_s = max(self.now_s, due[0])
            self.runner.poll(due[1])
        self.now_s = until
        self.runner.tidy()

    @property
    def job(self) -> QuantumJob:
        """The one job that was ever stored."""
        (job,) = self.store.rows.values()
        return job


@pytest.fixture
def harness() -> RunnerHarness:
    """A runner without jobs."""
    return RunnerHarness()


@pytest.fixture
def make_harness() -> type[RunnerHarness]:
    """Makes runners with other settings."""
    return RunnerHarness


@pytest.fixture
def limits() -> HardwareSettings:
    """The harness's settings."""
    return SETTINGS


@pytest.fixture
def done() -> Callable[..., JobView]:
    """Factory of views of jobs that are done; good unless told otherwise."""

    def make(counts: Any = SAMPLES, usage_s: Any = 1.5) -> JobView:
        return JobView("done", usage_s=usage_s, counts=counts)

    return make

"""What a cycle's result depends on beside its inputs: how far searches and solvers came in the time
that they had, and what the clock said. It is recorded, and played back when a cycle is made again.

A search by PyVRP is repeated with its number of iterations. Solvers of other kinds have no such
number: the answer of one that may have been ended by time, or was given by a device, is kept.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Any, Final, ParamSpec, Self, TypeVar

from dispatcher_daemon.planning.routes import Searched
from dispatcher_daemon.solvers import Outcome, Status
from dispatcher_daemon.solvers.workers import PoolJob, Solve, TimedExecutor

ENDED_BY_TIME: Final = 0.5
"""Share of its deadline from which on a solver's answer may be one that time has ended. The shares
at which solvers stop by themselves are larger: 0.6 (training of circuits) to 0.8 (exact).
"""
_NO_DEADLINE_S: Final = 86_400.0

P = ParamSpec("P")
T = TypeVar("T")
A = TypeVar("A")


@dataclass(frozen=True)
class RecordedAnswer:
    """What one solver said to one problem.

    Attributes:
        selected: as in `Outcome`, sorted.
        repeatable: whether the solver gives the same answer wherever it has the time.
    """

    solver: str
    status: Status
    selected: tuple[int, ...] | None
    repeatable: bool

    def outcome(self) -> Outcome:
        """The answer as a solver would give it."""
        selected = None if self.selected is None else frozenset(self.selected)
        reason = "no answer when it was recorded" if selected is None else None
        return Outcome(self.solver, self.status, selected, 0.0, reason=reason)


@dataclass(frozen=True)
class Trace:
    """What was recorded of one cycle.

    Attributes:
        clock_ms: time from each look at the clock to the next one.
        searches: numbers of iterations of each search's attempts; None: its worker died.
        cut: number of searches that time ended.
        answers: of the solvers, in the order of their jobs.
    """

    clock_ms: tuple[int, ...] = ()
    searches: tuple[tuple[int, ...] | None, ...] = ()
    cut: int = 0
    answers: tuple[RecordedAnswer, ...] = ()

    @property
    def kept(self) -> int:
        """Number of answers that are kept when the cycle is made again."""
        return sum(not answer.repeatable for answer in self.answers)


class _Submitted(Executor):
    """Hands calls on to another executor, each through a function that sees its future."""

    def __init__(self, submit: Callable[..., Future[Any]]) -> None:
        self._submit = submit

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        return self._submit(fn, *args, **kwargs)


class _TimedSubmitted(_Submitted, TimedExecutor):
    """The same for an executor that is told how long a call may take."""

    def __init__(
        self, submit: Callable[..., Future[Any]], submit_within: Callable[..., Future[Any]]
    ) -> None:
        super().__init__(submit)
        self._submit_within = submit_within

    def submit_within(
        self, within_s: float, limit_s: float, function: Callable[[A, float], T], argument: A
    ) -> Future[T]:
        return self._submit_within(within_s, limit_s, function, argument)


class TraceRecorder:
    """Stands between a cycle and its clock, executor and solvers; a context manager.

    Args:
        executor: of the searches; None: a thread of its own.
    """

    def __init__(
        self,
        solve: Solve,
        executor: Executor | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._solve, self._clock, self._began = solve, clock, clock()
        self._own = ThreadPoolExecutor(1) if executor is None else None
        self._inner = self._own or executor
        self._looked_ms: list[int] = []
        self._searches: list[Future[Any] | None] = []
        self._answers: list[RecordedAnswer] = []
        self.executor: Executor = _Submitted(self._submit)
        if isinstance(executor, TimedExecutor):
            self.executor = _TimedSubmitted(
                self._submit, partial(self._recorded, executor.submit_within)
            )

    def clock(self) -> float:
        """Seconds since the start, in the milliseconds that are recorded."""
        self._looked_ms.append(round(1000 * (self._clock() - self._began)))
        return self._looked_ms[-1] / 1000

    def solve(self, jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        """See `Solve`."""
        outcomes = self._solve(jobs, deadline_s)
        count = Counter(job.solver for job in jobs)
        for job, outcome in zip(jobs, outcomes, strict=True):
            # Jobs of one solver that queued have shared the deadline.
            self._answers.append(_answer(outcome, deadline_s / count[job.solver]))
        return outcomes

    def _submit(self, fn: Callable[..., Any], *args: Any, **kwargs: Any) -> Future[Any]:
        assert self._inner is not None
        return self._recorded(self._inner.submit, fn, *args, **kwargs)

    def _recorded(
        self, submit: Callable[..., Future[Any]], *args: Any, **kwargs: Any
    ) -> Future[Any]:
        self._searches.append(None)
        future = submit(*args, **kwargs)
        self._searches[-1] = future
        return future

    def trace(self) -> Trace:
        """What was recorded; searches that are not done count as those whose worker died."""
        looked = [0, *self._looked_ms]
        steps = tuple(b - a for a, b in pairwise(looked))
        done = [_result(future) for future in self._searches]
        return Trace(
            steps,
            tuple(None if found is None else found.iterations for found in done),
            sum(found is not None and found.cut for found in done),
            tuple(self._answers),
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._own is not None:
            self._own.shutdown()


@dataclass
class Player:
    """Stands where the recorder stood, and has the same happen again.

    Attributes:
        differing: by solver, number of answers to be repeated that came out otherwise.
    """

    trace: Trace
    inner: Solve
    workers: Executor
    differing: Counter[str] = field(default_factory=Counter)
    _looked: int = 0
    _now_ms: int = 0
    _searched: int = 0
    _asked: int = 0

    @property
    def executor(self) -> Executor:
        """For searches."""
        return _Submitted(self._submit)

    def clock(self) -> float:
        """What the clock said; it stands still after what was recorded."""
        if self._looked < len(self.trace.clock_ms):
            self._now_ms += self.trace.clock_ms[self._looked]
        self._looked += 1
        return self._now_ms / 1000

    def solve(self, jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        """See `Solve`."""
        known = self.trace.answers[self._asked : self._asked + len(jobs)]
        self._asked += len(jobs)
        answers: list[RecordedAnswer | None] = [*known, *[None] * (len(jobs) - len(known))]
        again = [job for job, answer in zip(jobs, answers, strict=True) if _is_solved(job, answer)]
        outcomes = iter(self.inner(again, _NO_DEADLINE_S) if again else ())
        return list(self._taken(jobs, answers, outcomes))

    def _taken(
        self,
        jobs: Sequence[PoolJob],
        answers: Sequence[RecordedAnswer | None],
        outcomes: Iterator[Outcome],
    ) -> Iterator[Outcome]:
        for job, answer in zip(jobs, answers, strict=True):
            if answer is not None and not _is_solved(job, answer):
                yield answer.outcome()
                continue
            outcome = next(outcomes)
            if answer is not None and _answer(outcome, _NO_DEADLINE_S).selected != answer.selected:
                self.differing[job.solver] += 1
            yield outcome

    def _submit(self, fn: Callable[..., Any], *args: Any, **kwargs: Any) -> Future[Any]:
        (job,) = args
        at, self._searched = self._searched, self._searched + 1
        if at < len(self.trace.searches):
            iterations = self.trace.searches[at]
            if iterations is None:
                died: Future[Any] = Future()
                died.set_exception(RuntimeError("its worker died when it was recorded"))
                return died
            job = job.repeating(iterations)
        return self.workers.submit(fn, job, **kwargs)


def _is_solved(job: PoolJob, answer: RecordedAnswer | None) -> bool:
    """Whether a job is solved again."""
    return answer is None or answer.solver != job.solver or answer.repeatable


def _answer(outcome: Outcome, deadline_s: float) -> RecordedAnswer:
    ran = outcome.execution
    on_device = ran is not None and (ran.kind == "hardware" or ran.fallback is not None)
    ended = outcome.status in ("timeout", "failed") or outcome.wall_s >= ENDED_BY_TIME * deadline_s
    selected = None if outcome.selected is None else tuple(sorted(outcome.selected))
    return RecordedAnswer(outcome.solver, outcome.status, selected, not (on_device or ended))


def _result(future: Future[Any] | None) -> Searched | None:
    try:
        found = None if future is None or not future.done() else future.result()
    except BaseException:
        return None
    return found if isinstance(found, Searched) else None

"""A search for routes of one part by PyVRP, as a worker runs it: attempts in turn."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import pyvrp
from pyvrp.exceptions import PenaltyBoundWarning
from pyvrp.search import NeighbourhoodParams, PerturbationParams
from pyvrp.stop import MaxIterations, MaxRuntime, MultipleCriteria, StoppingCriterion

from dispatcher_daemon.planning.routes.pyvrp_model import MWH_PER_KWH, NO_PATH_MWH, Visits
from dispatcher_daemon.settings import SearchSettings

_LONG_ITERATIONS: Final = 5000

HIGH_PENALTIES: Final = pyvrp.PenaltyParams(max_penalty=1e9)
"""The penalty starts at half of this: one excess unit costs more than an unserved stop."""


_FULL_FACTOR: Final = 10.0
_MEASURED_LOAD: Final = 5.0


def low_penalties(settings: SearchSettings, load: float, *, full: bool) -> pyvrp.PenaltyParams:
    """Low penalties: the search may pass through infeasible routes, and gets further.

    The setting was chosen with stops of some five units each. Where stops have fewer, a vehicle
    that takes one stop too many has fewer units too many, but saves the same detour.

    Args:
        load: mean demand of the stops.
        full: whether stops fill the vehicles, or the routes of a large city. One unit too many then
            saves so much that a lower penalty leaves nearly all routes that are searched
            infeasible.
    """
    factor = _FULL_FACTOR if full else 1.0
    if 0 < load < _MEASURED_LOAD:
        factor *= _MEASURED_LOAD / load
    return pyvrp.PenaltyParams(max_penalty=factor * settings.max_penalty_kwh * MWH_PER_KWH)


@dataclass(frozen=True)
class SearchAttempt:
    """A search.

    Attributes:
        first: whether the first feasible routes end it.
        deep: whether it has the iterations for larger steps; it is long then.
        stop_after: iterations after which it ends, whatever else would end it; None: not given.
    """

    data: pyvrp.ProblemData
    penalty: pyvrp.PenaltyParams
    iterations: int
    first: bool = False
    deep: bool = False
    stop_after: int | None = None

    @property
    def is_long(self) -> bool:
        """Whether it has the iterations for a wider search."""
        return self.deep or (not self.first and self.iterations >= _LONG_ITERATIONS)


@dataclass(frozen=True)
class Found:
    """Feasible routes and what they cost, mWh."""

    visits: Visits
    cost: float


@dataclass(frozen=True)
class SearchJob:
    """Attempts at the routes of one part, in turn."""

    attempts: Sequence[SearchAttempt]
    start: Visits | None
    limit_s: float
    seed: int

    @property
    def total_s(self) -> float:
        """Limit of all attempts together."""
        return self.limit_s * len(self.attempts)

    def repeating(self, iterations: Sequence[int]) -> SearchJob:
        """The same with these numbers of iterations of the first attempts, and no others."""
        numbered = zip(self.attempts, iterations, strict=False)
        attempts = [replace(attempt, stop_after=number) for attempt, number in numbered]
        return replace(self, attempts=attempts)


@dataclass(frozen=True)
class Searched:
    """What a job has found.

    Attributes:
        found: routes of the first attempt that finds feasible ones; None: none does.
        cut: whether that attempt's time ran out.
        iterations: of each attempt that was made.
    """

    found: Found | None
    cut: bool
    iterations: tuple[int, ...]


def search_in_turn(job: SearchJob) -> Searched:
    """Make a job's attempts until one finds feasible routes."""
    found, cut, iterations = None, False, list[int]()
    for attempt in job.attempts:
        found, cut, number = _search(attempt, job.start, job.limit_s, job.seed)
        iterations.append(number)
        if found is not None:
            break
    return Searched(found, cut, tuple(iterations))


def search_within(job: SearchJob, limit_s: float) -> Searched:
    """As `search_in_turn`, with at most so much time for all attempts together."""
    each_s = min(job.limit_s, limit_s / len(job.attempts))
    return search_in_turn(replace(job, limit_s=each_s))


def _search(
    attempt: SearchAttempt, start: Visits | None, limit_s: float, seed: int
) -> tuple[Found | None, bool, int]:
    data, begin = attempt.data, None
    if start is not None:
        begin = pyvrp.Solution(data, [pyvrp.Route(data, visits, kind) for kind, visits in start])
    stop: list[StoppingCriterion] = [MaxIterations(attempt.iterations), MaxRuntime(limit_s)]
    if attempt.first:
        stop.append(lambda best_cost: best_cost < NO_PATH_MWH)
    if attempt.stop_after is not None:
        stop = [MaxIterations(attempt.stop_after)]
    with warnings.catch_warnings():
        # PyVRP warns when windows are tight; whether the answer keeps them is looked at below.
        warnings.simplefilter("ignore", PenaltyBoundWarning)
        result = pyvrp.solve(
            data,
            MultipleCriteria(stop),
            seed=seed % 2**32,
            collect_stats=False,
            display=False,
            params=search_parameters(attempt.penalty, long=attempt.is_long, deep=attempt.deep),
            initial_solution=begin,
        )
    cut = attempt.stop_after is None and result.runtime >= limit_s
    if not result.best.is_feasible() or result.best.distance() >= NO_PATH_MWH:
        return None, cut, result.num_iterations
    visits = [
        (route.vehicle_type(), [a.idx for a in route if a.is_client()])
        for route in result.best.routes()
    ]
    return Found(visits, result.cost()), cut, result.num_iterations


def search_parameters(
    penalty: pyvrp.PenaltyParams, *, long: bool, deep: bool = False
) -> pyvrp.SolveParams:
    """Smaller steps than PyVRP's own, as they get further in seconds, unless the search is to be a
    deep one; one with few iterations looks at fewer neighbours and accepts less (docs/results.md).
    """
    return pyvrp.SolveParams(
        ils=pyvrp.IteratedLocalSearchParams(
            history_length=300 if long else 100, exhaustive_on_best=long
        ),
        penalty=penalty,
        neighbourhood=NeighbourhoodParams(num_neighbours=50 if long else 20),
        perturbation=PerturbationParams(1, 25 if deep else 10),
    )

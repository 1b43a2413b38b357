"""Cheapest insertion as a solver; it does not consider platooning."""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import pairwise

from dispatcher_daemon.forms import ArcProblem, BinaryProblem, Problem, RouteProblem
from dispatcher_daemon.solvers.protocol import Outcome


@dataclass(frozen=True)
class InsertionSolver:
    """Cheapest insertion of stops into routes; of route options, the cheapest that still fit."""

    name: str = "insertion"

    def warm_up(self) -> None:
        """Nothing to import."""

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`; the deadline is of no concern, and nothing is random."""
        began = time.perf_counter()
        if isinstance(problem, BinaryProblem):
            wall_s = time.perf_counter() - began
            return Outcome(self.name, "failed", None, wall_s, reason="there are no routes in it")
        if isinstance(problem, ArcProblem):
            selected = cheapest_insertion(problem)
        else:
            selected = cheapest_options(problem)
        return Outcome(
            solver=self.name,
            status="failed" if selected is None else "feasible",
            selected=selected,
            wall_s=time.perf_counter() - began,
            reason="ran into a dead end" if selected is None else None,
        )


def cheapest_insertion(problem: ArcProblem) -> frozenset[int] | None:
    """A valid arc selection, cheap but not optimal, without platooning.

    Each vehicle gets the cheapest first stop that only it can start with, or else any free one; the
    other stops are put in one by one where they add least.

    Returns:
        Arc indices; None if it runs into a dead end, which does not prove that there is no plan.
    """
    cost = {(a.vehicle, a.start, a.end): a.cost_kwh for a in problem.arcs}
    depot, missing = problem.depot, set(problem.customers)
    routes: dict[str, list[str]] = {}

    def choices(vehicle: str) -> list[str]:
        return [c for c in missing if (vehicle, depot, c) in cost and (vehicle, c, depot) in cost]

    for vehicle in sorted(problem.vehicles, key=lambda v: (len(choices(v)), v)):
        options = choices(vehicle)
        if not options:
            return None
        first = min(options, key=lambda c: (cost[vehicle, depot, c] + cost[vehicle, c, depot], c))
        routes[vehicle] = [first]
        missing.remove(first)
    while missing:
        candidates = []
        for vehicle, stops in routes.items():
            places = [depot, *stops, depot]
            for at, (before, after) in enumerate(pairwise(places)):
                for c in missing:
                    into, out = (vehicle, before, c), (vehicle, c, after)
                    if into in cost and out in cost:
                        extra = cost[into] + cost[out] - cost[vehicle, before, after]
                        candidates.append((extra, vehicle, at, c))
        if not candidates:
            return None
        _, vehicle, at, customer = min(candidates)
        routes[vehicle].insert(at, customer)
        missing.remove(customer)
    return problem.selection({v: tuple(stops) for v, stops in routes.items()})


def cheapest_options(problem: RouteProblem) -> frozenset[int] | None:
    """A valid selection, cheap but not optimal, without savings.

    Vehicles with fewer options choose first. Each takes the cheapest one that serves no stop again
    and leaves none behind that no later vehicle could serve.

    Returns:
        Option indices; None in a dead end, which does not prove that there is no valid selection.
    """
    order = sorted(problem.vehicles, key=lambda v: (len(problem.options_of[v]), v))
    later: list[set[str]] = [set()]
    for vehicle in reversed(order):
        served = {s for i in problem.options_of[vehicle] for s in problem.options[i].stops}
        later.append(later[-1] | served)
    later.reverse()
    missing = set(problem.stops)
    chosen = []
    for vehicle, servable in zip(order, later[1:], strict=True):
        fitting = [
            i
            for i in problem.options_of[vehicle]
            if missing.issuperset(problem.options[i].stops)
            and servable.issuperset(missing.difference(problem.options[i].stops))
        ]
        if not fitting:
            return None
        best = min(fitting, key=lambda i: (problem.options[i].cost_kwh, i))
        chosen.append(best)
        missing.difference_update(problem.options[best].stops)
    return None if missing else frozenset(chosen)

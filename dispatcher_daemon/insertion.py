"""A plan when no solver answers: cheapest insertion, in microseconds and without a library."""

from __future__ import annotations

from itertools import pairwise

from dispatcher_daemon.problem import ArcProblem


def cheapest_insertion(problem: ArcProblem) -> frozenset[int] | None:
    """A valid arc selection, cheap but not optimal, platooning left out of account.

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

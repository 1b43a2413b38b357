"""Random problems for checks: no geography, but what is rare on roads is common here.

Some have no solution, some rewards exceed the costs, some pairs of options lose by being chosen
together, some graphs are in pieces, some stops are served by nobody or by every option.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from dispatcher_daemon.forms import (
    ArcProblem,
    ArcReward,
    CandidateArc,
    Encoding,
    RouteOption,
    RouteProblem,
    constraint_rows,
)

_INFEASIBLE_SHARE = 0.15


def random_arc_problem(
    rng: np.random.Generator, max_variables: int, encoding: Encoding = "reduced"
) -> ArcProblem:
    """An arc problem of 1 to 3 vehicles and 1 to 5 customers. `max_variables`: of its QUBO in this
    encoding, at least 12.
    """
    while True:
        vehicles = int(rng.integers(1, 4))
        customers = int(rng.integers(vehicles, 6))
        problem = _arc_problem(rng, vehicles, customers, int(rng.integers(8, 19)))
        if problem.choices <= max_variables:
            variables, _ = constraint_rows(problem, encoding)
            if len(variables) <= max_variables:
                return problem


def _arc_problem(rng: np.random.Generator, vehicles: int, customers: int, arcs: int) -> ArcProblem:
    fleet = tuple(f"v{k}" for k in range(vehicles))
    names = tuple(f"c{i}" for i in range(customers))
    places = ("d", *names)
    every = [(k, i, j) for k in fleet for i in places for j in places if i != j]
    chosen: list[tuple[str, str, str]] = []
    if customers >= vehicles and rng.random() > _INFEASIBLE_SHARE:
        for vehicle, part in zip(fleet, _parts(rng, names, vehicles), strict=True):
            chosen += [(vehicle, i, j) for i, j in pairwise(("d", *part, "d"))]
    others = [every[n] for n in rng.permutation(len(every)) if every[n] not in chosen]
    kept = sorted(chosen + others[: max(0, arcs - len(chosen))])
    candidates = tuple(CandidateArc(k, i, j, float(rng.uniform(0.05, 0.4))) for k, i, j in kept)
    largest, share = float(rng.choice((0.03, 0.1, 0.5))), float(rng.uniform(0.0, 0.5))
    rewards = tuple(
        ArcReward(a, b, "e", float(rng.uniform(0.1, 1.0)) * largest)
        for a in range(len(candidates))
        for b in range(a + 1, len(candidates))
        if candidates[a].vehicle != candidates[b].vehicle and rng.random() < share
    )
    return ArcProblem("d", names, fleet, candidates, rewards)


def random_route_problem(rng: np.random.Generator, max_variables: int) -> RouteProblem:
    """A route problem of 2 to 6 vehicles whose options share out up to 8 stops."""
    vehicles = int(rng.integers(2, 7))
    fleet = tuple(f"v{k}" for k in range(vehicles))
    stops = tuple(f"s{i}" for i in range(int(rng.integers(0, 9))))
    served = list(stops)
    if stops and rng.random() < _INFEASIBLE_SHARE:
        served.pop(int(rng.integers(len(served))))
    total = int(rng.integers(2 * vehicles, max_variables + 1))
    # Each share-out gives every vehicle one option, so that options of one fit together.
    options: list[RouteOption] = []
    while len(options) < total:
        parts = _parts(rng, served, vehicles)
        for vehicle, part in zip(fleet, parts, strict=True):
            options.append(RouteOption(vehicle, part, float(rng.uniform(-0.1, 0.5))))
    options = sorted(options[:total], key=lambda option: option.vehicle)
    largest, share = float(rng.choice((0.03, 0.1, 0.5))), float(rng.uniform(0.0, 0.5))
    lowest = float(rng.choice((0.1, -1.0)))  # below 0: some pairs lose by being chosen together
    savings = {
        (a, b): float(rng.uniform(lowest, 1.0)) * largest
        for a in range(total)
        for b in range(a + 1, total)
        if options[a].vehicle != options[b].vehicle and rng.random() < share
    }
    return RouteProblem(fleet, stops, tuple(options), savings)


def _parts(
    rng: np.random.Generator, names: list[str] | tuple[str, ...], parts: int
) -> list[tuple[str, ...]]:
    """The names in random order, cut into parts of any length, as even as chance has it."""
    order = [names[i] for i in rng.permutation(len(names))]
    least = 1 if len(order) >= parts else 0
    cuts = np.sort(rng.integers(0, len(order) - least * parts + 1, parts - 1))
    bounds = [0, *(int(c) + least * (n + 1) for n, c in enumerate(cuts)), len(order)]
    return [tuple(order[low:high]) for low, high in pairwise(bounds)]

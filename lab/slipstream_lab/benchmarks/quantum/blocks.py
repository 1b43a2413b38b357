"""Blocks of a city's vehicles with a given number of variables, and their sweeps by smaller ones.

All of them are parts of one undivided route-form problem, so that objectives compare.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import networkx as nx

from dispatcher_daemon.forms import RouteProblem, violations
from dispatcher_daemon.planning.improvement import blocks_of
from slipstream_lab.benchmarks.routing.gap_run import block_of, undivided
from slipstream_lab.research.cities.generator import generate_city

_BETTER_KWH = 1e-9

Choose = Callable[[RouteProblem, int], frozenset[int] | None]
"""Solves a block, by problem and number of the block: its selection, or None."""


@dataclass(frozen=True)
class CityPart:
    """Some vehicles of a city, all others at their base routes.

    Attributes:
        problem: their options; the first of each is its base route.
        graph: who could meet whom, by name.
    """

    problem: RouteProblem
    graph: nx.Graph

    @property
    def start(self) -> frozenset[int]:
        """The base routes of all vehicles."""
        return frozenset(options[0] for options in self.problem.options_of.values())


def city_part(seed: int, size: tuple[int, int, int], variables: int) -> CityPart:
    """The vehicles of a generated city with the largest savings between them.

    Args:
        size: vehicles, stops and segments of the city.
        variables: exact number of options; the last vehicle may lose some of its own.

    Raises:
        ValueError: the city has less.
    """
    vehicles, stops, segments = size
    city = generate_city(seed, vehicles=vehicles, stops=stops, segments=segments)
    problem, graph = undivided(city, seed)
    return part_of(problem, graph, variables)


def part_of(problem: RouteProblem, graph: nx.Graph, variables: int) -> CityPart:
    """See `city_part`; parts of one problem are nested, the smaller in the larger."""
    counts = {v: len(options) for v, options in problem.options_of.items()}
    taken: list[str] = []
    left = variables
    for vehicle in order_by_weight(graph.subgraph(v for v, count in counts.items() if count > 1)):
        if left < 2:
            break
        taken.append(vehicle)
        left -= min(left, counts[vehicle])
    if left == 1:
        raise ValueError(f"no part of {variables} variables: take one more or less")
    if left:
        raise ValueError(f"the city has only {variables - left} variables")
    over = sum(counts[v] for v in taken) - variables
    start = frozenset(options[0] for options in problem.options_of.values())
    block, _ = block_of(problem, start, taken)
    return CityPart(without_last(block, over), graph.subgraph(taken))


def order_by_weight(graph: nx.Graph) -> list[str]:
    """Vehicles in greedy order: each has the largest weight to those before it."""
    degree = dict(graph.degree(weight="weight"))
    remaining = set(graph)
    tie = dict.fromkeys(sorted(graph), 0.0)
    order: list[str] = []
    while remaining:
        # Names decide between equals, so that the order does not depend on the set's.
        best = max(sorted(remaining), key=lambda v: (tie[v], degree[v]))
        order.append(best)
        remaining.discard(best)
        for neighbour, data in graph[best].items():
            tie[neighbour] += data["weight"]
    return order


def without_last(problem: RouteProblem, count: int) -> RouteProblem:
    """The problem without its last ``count`` options."""
    kept = problem.choices - count
    savings = {pair: saving for pair, saving in problem.savings.items() if max(pair) < kept}
    return RouteProblem(problem.vehicles, problem.stops, problem.options[:kept], savings)


@dataclass(frozen=True)
class SweepResult:
    """Result of sweeps over blocks.

    Attributes:
        objective_kwh: of the end.
        blocks: number of blocks solved in all sweeps.
        sweeps: their number, the idle ones at the end included.
    """

    objective_kwh: float
    blocks: int
    sweeps: int


def sweep(part: CityPart, variables: int, choose: Choose, patience: int, most: int) -> SweepResult:
    """Solve blocks in turn with all others fixed, until new partitions change nothing.

    Args:
        variables: of a block, at most.
        choose: solves a block.
        patience: sweeps without improvement that end it.
        most: sweeps.
    """
    problem = part.problem
    numbered = nx.convert_node_labels_to_integers(
        part.graph, label_attribute="name", ordering="sorted"
    )
    name = nx.get_node_attributes(numbered, "name")
    largest = max(len(options) for options in problem.options_of.values())
    chosen, value = part.start, problem.objective_kwh(part.start)
    idle = count = sweeps = 0
    while idle < patience and sweeps < most:
        before = value
        for group in blocks_of(numbered, max(2, variables // largest), sweeps):
            block, free = block_of(problem, chosen, [name[n] for n in group])
            selected = choose(block, count)
            count += 1
            if selected is None or violations(block, selected):
                continue
            changed = (chosen - set(free)) | {free[position] for position in selected}
            found = problem.objective_kwh(changed)
            if found < value - _BETTER_KWH:
                chosen, value = changed, found
        idle = 0 if value < before - _BETTER_KWH else idle + 1
        sweeps += 1
    return SweepResult(value, count, sweeps)


def ratio(start_kwh: float, best_kwh: float, found_kwh: float) -> float | None:
    """Approximation ratio: an answer's gain over the start, as a share of the best answer's.

    1 is the best, 0 the start, below 0 is worse than doing nothing; None if there is no gain.
    """
    gain = start_kwh - best_kwh
    return (start_kwh - found_kwh) / gain if gain > _BETTER_KWH else None

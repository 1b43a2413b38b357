"""A road network under given traffic as arrays, which searches need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Final, Literal

import numpy as np

from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads.costs import (
    held_cost_kwh,
    planning_speed_mps,
    segment_cost_kwh,
)
from dispatcher_daemon.roads.turns import Basis, TurnCosts, search_weights
from dispatcher_daemon.roads.weights import Floats, Ints, Weights
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.energy import steady_energy_kwh
from slipstream.vehicle_types import RoutingProfile

_S_PER_H: Final = 3600.0


@dataclass(frozen=True)
class Roads:
    """A network under given traffic as arrays over its segments, in the order of their ids, for
    vehicles of one profile.

    Attributes:
        profile: theirs.
        ids: segment ids.
        cost_kwh: expected energy of a vehicle alone, > 0, shape (m,).
        speed_mps: planning speeds, shape (m,).
        length_m: shape (m,).
        turn: pairs of segments (from, onto) that the vehicles may take, shape (2, t).
        costs: of paths; durations to about a second.
        objective: cost that the search minimises, kWh.
        search: the problem's.
        price_of_time_kw: the problem's.
        index: position by id.
        leaving: positions of the segments that leave a junction and that the vehicles may use, by
            junction; so `entering`.
    """

    profile: RoutingProfile
    ids: tuple[str, ...]
    cost_kwh: Floats
    speed_mps: Floats
    length_m: Floats
    turn: Ints
    costs: TurnCosts
    objective: Weights
    search: Literal["energy", "time"]
    price_of_time_kw: float
    index: Mapping[str, int] = field(repr=False)
    leaving: Mapping[str, list[int]] = field(repr=False)
    entering: Mapping[str, list[int]] = field(repr=False)

    @cached_property
    def turn_number(self) -> dict[tuple[int, int], int]:
        """Numbers of the turns, by (from, onto)."""
        return {(a, b): i for i, (a, b) in enumerate(self.turn.T.tolist())}

    def cost(self, weights: Weights, path: Sequence[int]) -> float:
        """Cost of a path over these segments."""
        return weights.along(path, [self.turn_number[pair] for pair in pairwise(path)])

    def searched_kwh(self, energy_kwh: float, duration_s: float) -> float:
        """What the search minimises, of a drive."""
        price_kw, of_energy = (1.0, 0.0) if self.search == "time" else (self.price_of_time_kw, 1.0)
        return of_energy * energy_kwh + price_kw * duration_s / _S_PER_H


def roads_of(
    problem: RoutingProblem, snapshot: TrafficSnapshot, profile: RoutingProfile | None = None
) -> Roads:
    """The arrays of a problem's network.

    Observed losses of movements are those of the problem's `vehicle`; other vehicles' are taken to
    differ as their costs of the segments do.

    Args:
        profile: of the vehicles; None: the fleet's first.
    """
    network = problem.network
    profile = problem.profiles[0] if profile is None else profile
    ids = tuple(sorted(network.segments))
    index = {name: i for i, name in enumerate(ids)}
    leaving: dict[str, list[int]] = {node: [] for node in network.junctions}
    entering: dict[str, list[int]] = {node: [] for node in network.junctions}
    usable = {name for name in ids if network.admits(name, profile)}
    for i, name in enumerate(ids):
        if name in usable:
            leaving[network.segments[name].start].append(i)
            entering[network.segments[name].end].append(i)
    pairs = [
        (index[a], index[b])
        for a in ids
        for b in dict.fromkeys(network.turns(a))
        if a in usable and b in usable and network.admits_turn(a, b, profile)
    ]
    turn = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    segments = [(network.segments[s], snapshot.segments[s]) for s in ids]
    cost = np.array([segment_cost_kwh(*pair, profile) for pair in segments])
    speed = np.array([planning_speed_mps(*pair, profile) for pair in segments])
    factor: Floats | float = 1.0
    observed = RoutingProfile(problem.vehicle)
    if snapshot.expected is not None and profile.physics != observed.physics:
        factor = cost / np.array([segment_cost_kwh(*pair, observed) for pair in segments])
        # Slow traffic hardly has drag: no vehicle loses less than it needs for rolling.
        own, other = profile.physics, observed.physics
        rolling = own.electrical_kwh(own.rolling_force_n)
        factor = np.maximum(factor, rolling / other.electrical_kwh(other.rolling_force_n))
    length = np.array([network.segments[s].length_m for s in ids])
    held = np.array([held_cost_kwh(*pair, profile) for pair in segments])
    calm = [
        steady_energy_kwh(*pair, vehicle=profile.physics)
        for pair in zip(length, speed, strict=True)
    ]
    stops = np.array([traffic.stops for _, traffic in segments])
    basis = Basis(
        *(ids, turn, cost, held, np.array(calm), stops, speed, length),
        problem.style,
        profile.physics,
    )
    exact = problem.objective == "energy"
    if snapshot.expected is not None:
        costs = basis.observed_costs(snapshot.expected, factor, exact=exact)
    else:
        costs = basis.drive_costs() if exact else basis.paper_costs()
    return Roads(
        profile,
        ids,
        cost,
        speed,
        length,
        turn,
        costs,
        search_weights(costs, problem.search, problem.price_of_time_kw),
        problem.search,
        problem.price_of_time_kw,
        index,
        leaving,
        entering,
    )

"""A road network under given traffic as arrays, which searches need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Final, Literal

import numpy as np

from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads.costs import follows_traffic, held_cost_kwh
from dispatcher_daemon.planning.roads.turns import Basis, TurnCosts, search_weights
from dispatcher_daemon.planning.roads.weights import Floats, Ints, Weights
from dispatcher_daemon.traffic import SegmentTraffic, TrafficSnapshot
from slipstream.energy.consumption import stop_energy_kwh
from slipstream.roads import RoadNetwork
from slipstream.vehicle_types import RoutingProfile

_S_PER_H: Final = 3600.0


@dataclass(frozen=True)
class Roads:
    """A network under given traffic as arrays over its segments, in the order of their ids, for
    vehicles of one profile.

    Attributes:
        cost_kwh: expected energy of a vehicle alone, > 0, shape (m,).
        speed_mps: planning speeds, shape (m,).
        length_m: shape (m,).
        turn: pairs of segments (from, onto) that the vehicles may take, shape (2, t).
        costs: of paths; durations to about a second.
        objective: cost that the search minimises, kWh.
        index: position by id.
        leaving: positions of usable segments that leave a junction, by junction; so `entering`.
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
    usable = network.usable(profile)
    traffic = [snapshot.segments[name] for name in usable.ids]
    stops = np.array([of.stops for of in traffic])
    speed, calm, held = _costs(network, traffic, profile)
    cost = held + stops * stop_energy_kwh(speed, profile.physics)
    factor: Floats | float = 1.0
    observed = RoutingProfile(problem.vehicle)
    if snapshot.expected is not None and profile.physics != observed.physics:
        other_speed, _, other_held = _costs(network, traffic, observed)
        factor = cost / (other_held + stops * stop_energy_kwh(other_speed, observed.physics))
        # Slow traffic hardly has drag: no vehicle loses less than it needs for rolling.
        own, other = profile.physics, observed.physics
        rolling = own.electrical_kwh(own.rolling_force_n)
        factor = np.maximum(factor, rolling / other.electrical_kwh(other.rolling_force_n))
    basis = Basis(
        *(usable.ids, usable.turns, cost, held, calm, stops, speed, usable.length_m),
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
        usable.ids,
        cost,
        speed,
        usable.length_m,
        usable.turns,
        costs,
        search_weights(costs, problem.search, problem.price_of_time_kw),
        problem.search,
        problem.price_of_time_kw,
        usable.index,
        usable.leaving,
        usable.entering,
    )


def _costs(
    network: RoadNetwork, traffic: Sequence[SegmentTraffic], profile: RoutingProfile
) -> tuple[Floats, Floats, Floats]:
    """Planning speeds, and `held_cost_kwh` of the segments in calm traffic and in theirs."""
    usable, physics = network.usable(profile), profile.physics
    speed = np.minimum([of.speed_mps for of in traffic], usable.limit_mps)
    force_n = physics.rolling_force_n + physics.drag_force_n(speed)
    calm = physics.electrical_kwh(force_n * usable.length_m)
    held = calm.copy()
    for i, of in enumerate(traffic):
        if follows_traffic(of):
            held[i] = held_cost_kwh(network.segments[of.segment], of, profile)
    return speed, calm, held

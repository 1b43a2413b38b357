"""What is to be solved: the routing problem, and its arc form that all solvers take."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

from dispatcher_daemon.drive import DrivingStyle
from dispatcher_daemon.fleet import Fleet
from slipstream.energy import PAPER_CAR, VehicleParameters
from slipstream.roads import RoadNetwork


@dataclass(frozen=True)
class RoutingProblem:
    """What does not change from cycle to cycle: roads, fleet, vehicle data, driving style."""

    network: RoadNetwork
    fleet: Fleet
    vehicle: VehicleParameters = PAPER_CAR
    style: DrivingStyle = field(default_factory=DrivingStyle)


@dataclass(frozen=True)
class CandidateArc:
    """One x_{ijk} of the paper: vehicle k may drive from i to j, for c_ij."""

    vehicle: str
    start: str
    end: str
    cost_kwh: float


@dataclass(frozen=True)
class ArcReward:
    """s_{e,k,l} for one pair of arcs of two vehicles, ``first`` < ``second`` being arc indices."""

    first: int
    second: int
    segment: str
    saving_kwh: float


@dataclass(frozen=True)
class ArcProblem:
    """The paper's arc form as plain data: small enough to send to a worker process.

    x_{e,k} x_{e,l} = Σ x_a x_b over the arcs a of k and b of l that run over segment e, so rewards
    are kept for pairs of arcs. Where entry times depend on the arc, so may the reward.

    Attributes:
        depot: name of the depot, no customer's name.
        customers: names, N of them.
        vehicles: names, K of them.
        arcs: candidate arcs, each (vehicle, start, end) at most once.
        rewards: savings > 0 for pairs of arcs of different vehicles.
    """

    depot: str
    customers: tuple[str, ...]
    vehicles: tuple[str, ...]
    arcs: tuple[CandidateArc, ...]
    rewards: tuple[ArcReward, ...] = ()

    def __post_init__(self) -> None:
        places = {self.depot, *self.customers}
        if len(places) != len(self.customers) + 1 or len(set(self.vehicles)) != len(self.vehicles):
            raise ValueError("depot, customers and vehicles need names of their own")
        keys = {(a.vehicle, a.start, a.end) for a in self.arcs}
        if len(keys) < len(self.arcs):
            raise ValueError("an arc is listed twice")
        for arc in self.arcs:
            if arc.vehicle not in self.vehicles or not {arc.start, arc.end} <= places:
                raise ValueError(f"arc of an unknown vehicle or place: {arc}")
            if arc.start == arc.end or not math.isfinite(arc.cost_kwh):
                raise ValueError(f"arc without a finite cost or a way: {arc}")
        for reward in self.rewards:
            if not 0 <= reward.first < reward.second < len(self.arcs):
                raise ValueError(f"reward for unknown arcs: {reward}")
            if self.arcs[reward.first].vehicle == self.arcs[reward.second].vehicle:
                raise ValueError(f"reward for a vehicle with itself: {reward}")
            if not (math.isfinite(reward.saving_kwh) and reward.saving_kwh > 0):
                raise ValueError(f"reward must be positive: {reward}")

    @cached_property
    def pair_savings(self) -> dict[tuple[int, int], float]:
        """Saving of each rewarded pair of arcs over all their shared segments, kWh."""
        pairs: dict[tuple[int, int], float] = {}
        for reward in self.rewards:
            pair = (reward.first, reward.second)
            pairs[pair] = pairs.get(pair, 0.0) + reward.saving_kwh
        return pairs

    def objective_kwh(self, selected: Collection[int]) -> float:
        """H_cost − H_platoon of a selection of arcs (paper section III-B)."""
        chosen = set(selected)
        cost = sum(self.arcs[i].cost_kwh for i in sorted(chosen))
        saving = sum(
            value for (a, b), value in self.pair_savings.items() if a in chosen and b in chosen
        )
        return cost - saving

    def selection(self, routes: Mapping[str, Sequence[str]]) -> frozenset[int] | None:
        """Arcs of given routes (stops in order, without the depot); None if one does not exist."""
        index = {(a.vehicle, a.start, a.end): i for i, a in enumerate(self.arcs)}
        chosen = set()
        for vehicle, stops in routes.items():
            places = [self.depot, *stops, self.depot]
            for leg in pairwise(places):
                if (vehicle, *leg) not in index:
                    return None
                chosen.add(index[vehicle, *leg])
        return frozenset(chosen)

    def without_platooning(self) -> ArcProblem:
        """The same model with H_platoon = 0: the paper's baseline (section II-C)."""
        return replace(self, rewards=())

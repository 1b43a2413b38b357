"""The routing problem, and its arc and route forms as solvers take them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

from dispatcher_daemon.fleet import Fleet, Vehicle
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.energy.consumption import PAPER_CAR, VehicleParameters
from slipstream.energy.drive import DrivingStyle
from slipstream.roads import RoadNetwork
from slipstream.spacing import ADVISED_GAP_M, longest_string
from slipstream.vehicle_types import RoutingProfile


@dataclass(frozen=True)
class RoutingProblem:
    """What does not change from cycle to cycle: roads, fleet, vehicle data, driving style.

    Attributes:
        vehicle: physical data of the vehicles that the fleet gives no type.
        search: what routes minimise. Reports contain energies in both cases.
        objective: with search "energy", what a path costs. "energy": its exact drive, with all
            changes of speed, and what traffic and signals are expected to add. "paper": the sum of
            its segments at their planning speeds (section III-C).
        price_of_time_kw: with search "energy", cost of travel time, kWh an hour.
        price_of_waiting_kw: of waiting at the depot for others, kWh an hour; 0: nothing.
        standing_kw: cost of waiting for other vehicles at a stop, kWh an hour; None: as driving
            time costs, and no less than waiting at the depot.
        drafting: what platoons save. "ideal": each is close from where it forms. "expected": less
            what its vehicles need to close up, and by the chance that signals keep them together;
            see `dispatcher_daemon.planning.platooning.expected`. The objective "paper" counts the
            ideal; the energy that is reported of its plans is by this all the same.
    """

    network: RoadNetwork
    fleet: Fleet
    vehicle: VehicleParameters = PAPER_CAR
    style: DrivingStyle = field(default_factory=DrivingStyle)
    search: Literal["energy", "time"] = "energy"
    objective: Literal["energy", "paper"] = "energy"
    price_of_time_kw: float = 0.0
    price_of_waiting_kw: float = 0.0
    standing_kw: float | None = None
    advised_gap_m: float = ADVISED_GAP_M
    drafting: Literal["ideal", "expected"] = "ideal"

    def __post_init__(self) -> None:
        for name in ("price_of_time_kw", "price_of_waiting_kw", "standing_kw"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{name} must be >= 0, got {value}")

    @property
    def price_of_standing_kw(self) -> float:
        """Cost of waiting for other vehicles at a stop, kWh an hour."""
        if self.standing_kw is not None:
            return self.standing_kw
        return max(self.price_of_time_kw, self.price_of_waiting_kw)

    def price_of_wait_kw(self, place: str) -> float:
        """Cost of waiting for other vehicles at a place on a tour, kWh an hour."""
        at_hub = place in self.fleet.hub_by_id
        return self.price_of_waiting_kw if at_hub else self.price_of_standing_kw

    @property
    def waits_on_tours(self) -> bool:
        """Whether vehicles may wait for each other at stops and hubs too."""
        return self.objective == "energy"

    @cached_property
    def _profiles(self) -> dict[tuple[object, object], RoutingProfile]:
        found: dict[tuple[object, object], RoutingProfile] = {}
        for vehicle in self.fleet.vehicles:
            kind = self.fleet.type_of(vehicle)
            key = vehicle.type, vehicle.own_type
            found[key] = RoutingProfile(self.vehicle) if kind is None else kind.profile
        return found

    @property
    def profiles(self) -> tuple[RoutingProfile, ...]:
        """The distinct profiles of the fleet's vehicles, in their order; at least one."""
        return tuple(dict.fromkeys(self._profiles.values())) or (RoutingProfile(self.vehicle),)

    @cached_property
    def longest_platoon(self) -> int:
        """Number of vehicles of the fleet that a platoon has at most: what each type allows."""
        of = [longest_string(self.advised_gap_m, profile.braking) for profile in self.profiles]
        return min(of)

    def profile_of(self, vehicle: Vehicle | str) -> RoutingProfile:
        """What decides a vehicle's ways and their costs.

        Args:
            vehicle: of the fleet, or like one of them; or its id.
        """
        of = self.fleet.vehicle_by_id[vehicle] if isinstance(vehicle, str) else vehicle
        return self._profiles[of.type, of.own_type]


def routing_problem(
    network: RoadNetwork, fleet: Fleet, settings: DispatcherSettings
) -> RoutingProblem:
    """The problem of a dispatcher's fleet under its settings' objective and prices."""
    if settings.objective == "paper":
        return RoutingProblem(
            network, fleet, objective="paper", advised_gap_m=settings.gap_m, drafting="expected"
        )
    prices = settings.prices
    return RoutingProblem(
        network,
        fleet,
        price_of_time_kw=prices.price_of_time_kw,
        price_of_waiting_kw=prices.price_of_waiting_kw,
        standing_kw=prices.standing_kw,
        advised_gap_m=settings.gap_m,
        drafting="expected",
    )


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
    """The paper's arc form as plain, picklable data.

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

    @property
    def choices(self) -> int:
        """Number of binary decision variables x."""
        return len(self.arcs)

    @cached_property
    def costs_kwh(self) -> tuple[float, ...]:
        """Cost of each arc."""
        return tuple(arc.cost_kwh for arc in self.arcs)

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
        return _objective_kwh(self, selected)

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


@dataclass(frozen=True)
class RouteOption:
    """One x_{k,r}: vehicle k serves these stops in this order, by one path and departure.

    Attributes:
        vehicle: k.
        stops: in order; none where the vehicle stays idle.
        cost_kwh: finite; below 0 where rewards with vehicles outside the problem are counted in.
    """

    vehicle: str
    stops: tuple[str, ...]
    cost_kwh: float


@dataclass(frozen=True)
class RouteProblem:
    """The route form as plain, picklable data.

    A selection is valid if it has exactly one option of each vehicle and serves every stop once.

    Attributes:
        vehicles: names, K of them.
        stops: names of the stops that the options serve.
        options: route options; the index is the x.
        savings: kWh by pair (a, b) of options of different vehicles, a < b; less than 0 where the
            options' costs hold more savings than both can have together.
    """

    vehicles: tuple[str, ...]
    stops: tuple[str, ...]
    options: tuple[RouteOption, ...]
    savings: Mapping[tuple[int, int], float] = field(default_factory=dict)

    @property
    def choices(self) -> int:
        """Number of binary decision variables x."""
        return len(self.options)

    @cached_property
    def costs_kwh(self) -> tuple[float, ...]:
        """Cost of each option."""
        return tuple(option.cost_kwh for option in self.options)

    @property
    def pair_savings(self) -> Mapping[tuple[int, int], float]:
        """`savings`, by the arc form's name."""
        return self.savings

    @cached_property
    def options_of(self) -> dict[str, tuple[int, ...]]:
        """Indices of each vehicle's options, in order."""
        groups: dict[str, list[int]] = {vehicle: [] for vehicle in self.vehicles}
        for index, option in enumerate(self.options):
            groups[option.vehicle].append(index)
        return {vehicle: tuple(group) for vehicle, group in groups.items()}

    def objective_kwh(self, selected: Collection[int]) -> float:
        """Σ c_{k,r} x_{k,r} − Σ s x x of a selection of options."""
        return _objective_kwh(self, selected)

    def without_platooning(self) -> RouteProblem:
        """The same options without savings between them."""
        return replace(self, savings={})


@dataclass(frozen=True)
class BinaryProblem:
    """Any QUBO, Σ c_i x_i − Σ s_ij x_i x_j: each selection is valid, none stands for routes.

    Solvers take it as the other forms; what these call kWh is in units of its own.

    Attributes:
        names: of the variables.
        costs_kwh: c, finite.
        pair_savings: s by pair (i, j), i < j; finite, and below 0 for a coupling that costs.
    """

    names: tuple[str, ...]
    costs_kwh: tuple[float, ...]
    pair_savings: Mapping[tuple[int, int], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(set(self.names)) < len(self.names) or len(self.names) != len(self.costs_kwh):
            raise ValueError("each variable needs a name of its own, and a cost")
        if not all(math.isfinite(value) for value in self.costs_kwh):
            raise ValueError("costs must be finite")
        for (first, second), saving in self.pair_savings.items():
            if not (0 <= first < second < len(self.names) and math.isfinite(saving)):
                raise ValueError(f"pair of unknown variables, or not finite: {(first, second)}")

    @property
    def choices(self) -> int:
        """Number of binary decision variables x."""
        return len(self.names)

    def objective_kwh(self, selected: Collection[int]) -> float:
        """Σ c_i x_i − Σ s_ij x_i x_j."""
        return _objective_kwh(self, selected)


Problem = ArcProblem | RouteProblem | BinaryProblem
"""What solvers take: `choices` binary x, `costs_kwh`, `pair_savings`, `objective_kwh`."""


def _objective_kwh(problem: Problem, selected: Collection[int]) -> float:
    chosen = set(selected)
    cost = sum(problem.costs_kwh[i] for i in sorted(chosen))
    return cost - sum(
        value for (a, b), value in problem.pair_savings.items() if a in chosen and b in chosen
    )

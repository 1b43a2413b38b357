"""Finished routes as verified plans: what any form and solver has to get through."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from dispatcher_daemon.plans.energy import RouteEnergy, route_energy
from dispatcher_daemon.plans.messages import vehicle_plans
from dispatcher_daemon.plans.verify import verify_plans
from dispatcher_daemon.platooning.platoons import Passage, Place, form_platoons
from dispatcher_daemon.platooning.vehicles_on_road import RoadUser, joined_segments
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads.routes import Route
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.messages import SolverReport, VehiclePlan


@dataclass(frozen=True)
class Candidate:
    """A verified plan set.

    Attributes:
        solver: what made it.
        objective_kwh: H_cost − H_platoon, re-evaluated.
        plans: one for each vehicle that drives.
        energies: of these plans.
        joined: places of vehicles on the road in platoons with those of the plans.
    """

    solver: str
    objective_kwh: float
    plans: tuple[VehiclePlan, ...]
    energies: tuple[RouteEnergy, ...]
    joined: Mapping[Passage, Place] = field(default_factory=dict)


@dataclass(frozen=True)
class Cycle:
    """What is fixed within one cycle.

    Attributes:
        number: of the cycle.
        now_ns: UTC at its start.
        seed: of everything random in it.
        reference_s: from its start to the moment that the fleet's times count from, when a vehicle
            that is ready at once leaves.
        on_road: vehicles that earlier cycles sent.
    """

    problem: RoutingProblem
    snapshot: TrafficSnapshot
    settings: DispatcherSettings
    number: int
    now_ns: int
    seed: int
    reference_s: float
    on_road: tuple[RoadUser, ...] = ()

    def candidate(
        self,
        solver: str,
        routes: Sequence[Route],
        objective_kwh: float,
        *,
        platooning: bool = True,
        unserved: Mapping[str, str] | None = None,
    ) -> Candidate | str:
        """The verified plan set of finished routes, or what is wrong with it.

        Args:
            unserved: stops that no route has to serve.
        """
        settings = self.settings
        window = settings.sync_window_s
        places: dict[Passage, Place] = {}
        if platooning:
            others = [p for user in self.on_road for p in user.passages()]
            places = form_platoons(routes, self.snapshot, window, self.number, others)
        energies = tuple(route_energy(self.problem, route, places) for route in routes)
        plans = vehicle_plans(
            self.problem,
            self.snapshot,
            routes,
            places,
            energies,
            cycle=self.number,
            issued_ns=self.now_ns,
            valid_s=2 * settings.interval_s,
            gap_m=settings.gap_m,
            advice=settings.advice,
        )
        faults = verify_plans(
            plans,
            self.problem.network,
            self.problem.fleet,
            {name for name, t in self.snapshot.segments.items() if t.open},
            window,
            unserved=unserved or {},
            reference_s=self.reference_s,
            joined=joined_segments(self.on_road, places, settings.gap_m),
        )
        if faults:
            return faults[0]
        sent = {route.vehicle for route in routes}
        joined = {passage: place for passage, place in places.items() if passage[0] not in sent}
        return Candidate(solver, objective_kwh, plans, energies, joined)


@dataclass(frozen=True)
class Found:
    """What the solvers of one form came to in one cycle.

    Attributes:
        candidates: verified plan sets, the baseline's apart.
        reports: of the solvers.
        baseline: name of what made the plan without platooning.
        alone: that plan, every vehicle alone, or what is wrong with it.
        fallback: the same routes with the platoons that come about by chance.
        variables: of the largest QUBO.
        unserved: reason by stop that nobody serves.
        stops: by vehicle, of the best routes; for the next cycle to start from.
    """

    candidates: tuple[Candidate, ...]
    reports: tuple[SolverReport, ...]
    baseline: str
    alone: Candidate | str
    fallback: Candidate | str
    variables: int
    unserved: Mapping[str, str] = field(default_factory=dict)
    stops: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

"""What is fixed in one cycle, and finished routes as verified plans or a refusal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from dispatcher_daemon.fleet import Commitment, Passage, RoadUser
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.plans.energy import RouteEnergy, route_energy
from dispatcher_daemon.planning.plans.messages import vehicle_plans
from dispatcher_daemon.planning.plans.verify import verify_plans
from dispatcher_daemon.planning.platooning import (
    Place,
    expected_drafting,
    form_platoons,
    joined_segments,
)
from dispatcher_daemon.planning.roads import Route
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.energy.consumption import Energy, total
from slipstream.messages import SolverReport, VehiclePlan

Gains = dict[str | None, float]
"""By carrier, what it has more than alone, kWh of the objective; None: vehicles without one."""


@dataclass(frozen=True)
class Candidate:
    """A verified plan set.

    Attributes:
        objective_kwh: H_cost − H_platoon, re-evaluated.
        routes: timetables of the vehicles that drive.
        plans: of these routes, in their order.
        energies: likewise.
        joined: places of vehicles on the road in platoons with those of the plans.
        gains_kwh: of fleets of several carriers.
    """

    solver: str
    objective_kwh: float
    routes: tuple[Route, ...]
    plans: tuple[VehiclePlan, ...]
    energies: tuple[RouteEnergy, ...]
    joined: Mapping[Passage, Place] = field(default_factory=dict)
    gains_kwh: Gains = field(default_factory=dict)

    @property
    def driven(self) -> Energy:
        """E_physical of all routes, drafting included."""
        return total(e.driven for e in self.energies)

    @property
    def undrafted(self) -> Energy:
        """E_physical of all routes without drafting."""
        return total(e.undrafted for e in self.energies)

    @property
    def platooned_m(self) -> float:
        """Distance driven in platoons, as leader or follower."""
        return sum(e.platooned_m for e in self.energies)


@dataclass(frozen=True)
class CandidateRefusal:
    """Why there is no verified plan set.

    Attributes:
        faults: at least one; of an answer, the rules that it breaks.
    """

    faults: tuple[str, ...]

    @property
    def reason(self) -> str:
        """The first fault."""
        return self.faults[0]


@dataclass(frozen=True)
class Cycle:
    """What is fixed within one cycle.

    Attributes:
        now_ns: UTC at its start.
        reference_delay_s: see `reference_s`; None: the deadline, so that plans are out before.
        on_road: vehicles that earlier cycles sent. The route form plans to meet them; they stay as
            they are, but for their places in platoons.
        start: stops by vehicle that the search for routes starts from, as of the last cycle.
        commitments: of vehicles that the cycle plans on from where they are, each once. They and
            their stops are part of the fleet. It takes the route form.
    """

    problem: RoutingProblem
    snapshot: TrafficSnapshot
    settings: DispatcherSettings
    number: int
    now_ns: int
    seed: int
    reference_delay_s: float | None = None
    on_road: tuple[RoadUser, ...] = ()
    start: Mapping[str, Sequence[str]] | None = None
    commitments: tuple[Commitment, ...] = ()

    @property
    def reference_s(self) -> float:
        """From its start to when a vehicle that is ready at once leaves, s."""
        delay_s = self.reference_delay_s
        return self.settings.deadline_s if delay_s is None else delay_s

    def candidate(
        self,
        solver: str,
        routes: Sequence[Route],
        objective_kwh: float,
        *,
        platooning: bool = True,
        unserved: Mapping[str, str] | None = None,
        gains_kwh: Gains | None = None,
    ) -> Candidate | CandidateRefusal:
        """The verified plan set of finished routes, or what is wrong with it.

        Args:
            unserved: stops that no route has to serve.
        """
        settings = self.settings
        window = settings.sync_window_s
        places: dict[Passage, Place] = {}
        if platooning:
            others = [p for user in self.on_road for p in user.passages()]
            expected = expected_drafting(
                self.problem, self.snapshot, self.commitments, self.on_road
            )
            places = form_platoons(
                routes,
                self.snapshot,
                window,
                self.problem.longest_platoon,
                self.number,
                others,
                expected,
            )
        energies = tuple(route_energy(self.problem, route, places) for route in routes)
        plans = vehicle_plans(
            self.problem,
            self.snapshot,
            settings,
            routes,
            places,
            energies,
            cycle=self.number,
            issued_ns=self.now_ns,
            reference_s=self.reference_s,
            commitments=self.commitments,
        )
        faults = verify_plans(
            plans,
            self.problem.network,
            self.problem.fleet,
            {name for name, t in self.snapshot.segments.items() if t.open},
            window,
            longest=self.problem.longest_platoon,
            unserved=unserved or {},
            reference_s=self.reference_s,
            joined=joined_segments(self.on_road, places, settings.gap_m),
            commitments=self.commitments,
        )
        if faults:
            return CandidateRefusal(tuple(faults))
        sent = {route.vehicle for route in routes}
        joined = {passage: place for passage, place in places.items() if passage[0] not in sent}
        found = tuple(routes), plans, energies, joined
        return Candidate(solver, objective_kwh, *found, gains_kwh or {})


@dataclass(frozen=True)
class DeclinedMeeting:
    """A platoon of two that a solver could have chosen, and did not.

    Attributes:
        segments: on which the two would be together, by the first one's way.
        cost_kwh: of other ways or departures.
        saving_kwh: of it, and what else changes by them; not more than the cost.
    """

    vehicles: tuple[str, str]
    segments: tuple[str, ...]
    cost_kwh: float
    saving_kwh: float


@dataclass(frozen=True)
class FormResult:
    """Result of one form's solvers in one cycle.

    Attributes:
        candidates: verified plan sets, without the baseline's.
        baseline_solver: name of the solver of the plan without platooning.
        baseline: that plan, or what is wrong with it.
        fallback: the same routes with the platoons that form by chance.
        variables: of the largest QUBO.
        stops: by vehicle, of the best routes; the next cycle's search starts from them.
        declined: meetings that were on offer in the last sweep.
    """

    candidates: tuple[Candidate, ...]
    reports: tuple[SolverReport, ...]
    baseline_solver: str
    baseline: Candidate | CandidateRefusal
    fallback: Candidate | CandidateRefusal
    variables: int
    unserved: Mapping[str, str] = field(default_factory=dict)
    stops: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    declined: tuple[DeclinedMeeting, ...] = ()

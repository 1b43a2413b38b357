"""The paper's arc form of one cycle: one problem, and the plans of its selections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.forms import ArcProblem, decode
from dispatcher_daemon.planning.arc_form.arcs import arc_parts
from dispatcher_daemon.planning.improvement import Choice, choice_of, scheduled
from dispatcher_daemon.planning.plans import Candidate, CandidateRefusal, Cycle
from dispatcher_daemon.planning.platooning import JudgedPair
from dispatcher_daemon.planning.roads import RoadLeg, Route, RoutedArc, timetable
from dispatcher_daemon.planning.routes import Planner
from dispatcher_daemon.solvers import BASELINE_SOLVER, Outcome, cheapest_insertion
from dispatcher_daemon.solvers.workers import PoolJob
from slipstream.vehicle_types import RoutingProfile


@dataclass(frozen=True)
class ArcForm:
    """A cycle's fleet as one problem for solvers, and the plans of their selections.

    Attributes:
        cycle: its problem has no stop that no vehicle can serve.
        unserved: these stops, with the reason.
        legs: least-energy paths by (from, to).
        arcs: the candidate arcs.
        judged: every pair of arcs that share a watched segment, and why it platoons or not.
    """

    cycle: Cycle
    unserved: Mapping[str, str]
    legs: Mapping[tuple[str, str], RoadLeg]
    arcs: tuple[RoutedArc, ...]
    judged: tuple[JudgedPair, ...]
    problem: ArcProblem
    name: Literal["arc"] = "arc"

    def candidate(
        self, solver: str, selected: frozenset[int], *, platooning: bool = True
    ) -> Candidate | CandidateRefusal:
        """The verified plans of a selection of arcs.

        Departures are chosen within the vehicles' windows so that platoons meet. The objective is
        that of the exact times: rewards of the arc form may rest on entry times that are too early.
        """
        problem, cycle = self.problem, self.cycle
        if not all(0 <= index < len(problem.arcs) for index in selected):
            return CandidateRefusal(("not a selection of arcs",))
        decoded = decode(problem, selected)
        if decoded.routes is None:
            return CandidateRefusal(tuple(decoded.violations))
        routes = [
            timetable(cycle.problem, self.legs, v, decoded.routes[v.id], cycle.reference_s)
            for v in cycle.problem.fleet.vehicles
        ]
        if not platooning:
            cost = problem.without_platooning().objective_kwh(selected)
            return cycle.candidate(solver, routes, cost, platooning=False)
        choice = self._scheduled(routes)
        if choice is None:
            return cycle.candidate(solver, routes, problem.objective_kwh(selected))
        return cycle.candidate(solver, choice.routes, choice.objective_kwh)

    def _scheduled(self, routes: Sequence[Route]) -> Choice | None:
        """Departures as early as can be, or at which platoons meet; None: a window is missed."""
        cycle = self.cycle
        window_s = cycle.settings.sync_window_s
        planner = Planner(cycle.problem, cycle.snapshot, [], window_s, cycle.reference_s)
        present = [
            planner.itinerary(n, tuple(v.place for v in route.visits[1:-1]), route.legs)
            for n, route in enumerate(routes)
        ]
        itineraries = [itinerary for itinerary in present if itinerary is not None]
        if len(itineraries) < len(routes):
            return None
        base = choice_of(planner, itineraries)
        return min(base, scheduled(planner, base), key=lambda c: c.objective_kwh)

    @property
    def baseline_job(self) -> PoolJob:
        """The job for the plan without platooning."""
        return PoolJob(BASELINE_SOLVER, self.problem.without_platooning(), self.cycle.seed)

    def baseline_answer(self, outcome: Outcome) -> tuple[str, frozenset[int] | None]:
        """Solver and arcs of the plan without platooning; by insertion if it has no answer."""
        if outcome.selected is not None:
            return outcome.solver, outcome.selected
        return "insertion", cheapest_insertion(self.problem)


def arc_form(cycle: Cycle, unserved: Mapping[str, str] | None = None) -> ArcForm:
    """The arc form of a cycle whose stops can all be served.

    Args:
        unserved: stops that were left out before, with the reason.

    Raises:
        ValueError: the arc form cannot express the fleet (`arc_form_obstacle`).
    """
    obstacle = arc_form_obstacle(cycle.problem.fleet)
    if obstacle is not None:
        raise ValueError(obstacle)
    window_s = cycle.settings.sync_window_s
    parts = arc_parts(cycle.problem, cycle.snapshot, window_s, cycle.reference_s)
    return ArcForm(cycle, unserved or {}, *parts)


def arc_form_obstacle(fleet: Fleet) -> str | None:
    """Why the arc form (the paper's) cannot express a fleet; None if it can.

    In it every vehicle drives, stops have no times, no load or charge is counted, all vehicles
    share one set of paths, and nobody asks what each carrier has. A capacity that no set of stops
    can exceed is no obstacle, nor is a departure window: vehicles then leave when they are ready.
    """
    kinds = {vehicle.id: fleet.type_of(vehicle) for vehicle in fleet.vehicles}
    if len({RoutingProfile() if kind is None else kind.profile for kind in kinds.values()}) > 1:
        return "its vehicles are of different types"
    for name, kind in kinds.items():
        if kind is not None and kind.battery_kwh is not None:
            return f"vehicle {name!r} has a battery"
    if len(fleet.carriers) > 1:
        return "its vehicles are of different carriers"
    for stop in fleet.stops:
        if stop.carrier not in (None, *fleet.carriers):
            return f"stop {stop.id!r} is of another carrier than the vehicles"
        if not all(fleet.may_serve(vehicle, stop) for vehicle in fleet.vehicles):
            return f"stop {stop.id!r} is not for all vehicles"
        if stop.earliest_s > 0 or stop.latest_s is not None:
            return f"stop {stop.id!r} has a time window"
    demand = {stop.id: stop.demand for stop in fleet.stops}
    pooled = sum(demand[name] for name in fleet.pooled)
    for vehicle in fleet.vehicles:
        if vehicle.breaks:
            return f"vehicle {vehicle.id!r} has breaks"
        if vehicle.return_by_s is not None:
            return f"vehicle {vehicle.id!r} has to be back in time"
        if fleet.overload(vehicle.model_copy(update={"capacity": None}), fleet.stops) is not None:
            return f"vehicle {vehicle.id!r} cannot carry the mass of all stops"
        most = pooled + (0 if vehicle.first_stop is None else demand[vehicle.first_stop])
        if vehicle.capacity is not None and most > vehicle.capacity:
            return (
                f"vehicle {vehicle.id!r} has a capacity of {vehicle.capacity} "
                f"and could be given a demand of {most}"
            )
    free = sum(vehicle.first_stop is None for vehicle in fleet.vehicles)
    if free > len(fleet.pooled):
        return (
            f"every vehicle has to drive, and {free} without a first stop are too many "
            f"for {len(fleet.pooled)} pooled stops"
        )
    return None

"""What a solver's answer is worth: checked, re-evaluated, and as energy on the road."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dispatcher_daemon.formulations.decode import violations
from dispatcher_daemon.plans.energy import route_energy
from dispatcher_daemon.platooning.platoons import Passage, Place, form_platoons
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads.routes import Route, lateness_s
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.traffic import TrafficSnapshot
from research.solving.forms import Form
from slipstream.energy import Energy, Saving, split_saving, total

_TOLERANCE_S = 1e-6


@dataclass(frozen=True)
class Trial:
    """One solver on one instance.

    Attributes:
        outcome: as the solver gave it.
        faults: rules that its answer breaks: the form's, then windows and capacities.
        objective_kwh: H_cost − H_platoon, re-evaluated; None without a valid selection.
        model_kwh: what the solver minimised; it differs by a constant in the route form, and by
            what pairs miss of platoons of three and more.
        routes: timetables; none if the answer is no route set.
        energy: E_physical of the routes, drafting included.
        saving: against the plan without platooning, every vehicle alone; None without that plan.
        platooned_m: driven in platoons, as leader or follower.
    """

    outcome: Outcome
    faults: tuple[str, ...]
    objective_kwh: float | None = None
    model_kwh: float | None = None
    routes: tuple[Route, ...] = ()
    energy: Energy | None = None
    saving: Saving | None = None
    platooned_m: float = 0.0

    @property
    def is_valid(self) -> bool:
        """True if there is an answer that breaks no rule."""
        return self.outcome.selected is not None and not self.faults


def appraise(
    form: Form,
    snapshot: TrafficSnapshot,
    sync_window_s: float,
    outcome: Outcome,
    baseline: Sequence[Route] | None,
) -> Trial:
    """Check an outcome and find out what it is worth.

    Args:
        form: what was solved.
        baseline: routes without platooning.
    """
    selected = outcome.selected
    if selected is None:
        return Trial(outcome, ())
    faults = violations(form.problem, selected)
    if faults:
        return Trial(outcome, faults)
    routing, routes = form.routing, form.routes(selected)
    places = form_platoons(routes, snapshot, sync_window_s, cycle=0)
    energies = [route_energy(routing, route, places) for route in routes]
    driven, alone = total(e.driven for e in energies), total(e.alone for e in energies)
    saving = None
    if baseline is not None:
        none: dict[Passage, Place] = {}
        base = total(route_energy(routing, route, none).alone for route in baseline)
        saving = split_saving(base, alone, driven)
    return Trial(
        outcome,
        road_faults(routing, routes),
        form.objective_kwh(selected),
        form.problem.objective_kwh(selected),
        tuple(routes),
        driven,
        saving,
        sum(e.platooned_m for e in energies),
    )


def road_faults(routing: RoutingProblem, routes: Sequence[Route]) -> tuple[str, ...]:
    """Windows that are missed and capacities that are exceeded, in words."""
    faults = []
    by_id = {vehicle.id: vehicle for vehicle in routing.fleet.vehicles}
    for route in routes:
        vehicle = by_id[route.vehicle]
        late = lateness_s(routing, vehicle, route)
        if late > _TOLERANCE_S:
            faults.append(f"{vehicle.id}: {late:.1f} s too late for one of its windows")
        load = sum(routing.fleet.stop_by_id[visit.place].demand for visit in route.visits[1:-1])
        if vehicle.capacity is not None and load > vehicle.capacity:
            faults.append(f"{vehicle.id}: loads {load}, more than its {vehicle.capacity}")
    return tuple(faults)

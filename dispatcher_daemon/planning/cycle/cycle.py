"""One dispatch cycle as a function: traffic, fleet and time in; verified plans and a report out."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np

from dispatcher_daemon.fleet import Commitment, Fleet, Passage, RoadUser
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.arc_form import ArcForm, arc_cycle, arc_form, arc_form_obstacle
from dispatcher_daemon.planning.improvement import refused_platoons
from dispatcher_daemon.planning.plans import (
    Candidate,
    CandidateRefusal,
    Cycle,
    FormResult,
    RouteEnergy,
    plan_energies,
    plans_to_send,
    summarise,
    vehicle_accounts,
)
from dispatcher_daemon.planning.platooning import Place
from dispatcher_daemon.planning.route_form import route_cycle
from dispatcher_daemon.planning.routes import servable_part
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.workers import Solve
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.energy.consumption import total
from slipstream.energy.ledger import PlanEnergy
from slipstream.errors import InputError
from slipstream.explain import RefusedPlatoon, VehicleAccount
from slipstream.messages import CarrierSummary, CycleReport, Unserved, VehiclePlan

log = logging.getLogger(__name__)

MAX_ARC_VEHICLES: Final = 2
MAX_ARC_STOPS: Final = 8
"""A larger fleet is dispatched in route form, unless the settings say otherwise."""


@dataclass(frozen=True)
class CycleResult:
    """Result of one cycle.

    Attributes:
        report: for the dashboard and the database.
        plans: verified plans that go out; none if the cycle failed.
        stops: by vehicle, of the route form's plan; the next cycle's search starts from them.
        joined: places of vehicles on the road in platoons with vehicles of these plans.
        accounts: what each vehicle does, alone and in the baseline too; none without a baseline.
        energies: by vehicle, of all verified plans; for the energy ledger.
    """

    report: CycleReport
    plans: tuple[VehiclePlan, ...]
    stops: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    joined: Mapping[Passage, Place] = field(default_factory=dict)
    accounts: tuple[VehicleAccount, ...] = ()
    refused: tuple[RefusedPlatoon, ...] = ()
    energies: Mapping[str, PlanEnergy] = field(default_factory=dict)


def run_cycle(
    cycle: Cycle,
    solve: Solve,
    executor: Executor | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> CycleResult:
    """Run one dispatch cycle.

    The same cycle and a `solve` that keeps to its seeds give the same result, wall times aside.

    Args:
        solve: runs solvers by name, within the deadline, without raising.
        executor: for the search of the route form's base routes; None: this thread.
        clock: seconds; the deadline of the route form and the report's wall time count by it.

    Returns:
        The best verified plans of the solvers that answered; the baseline's if none did; a report
        of status "failed" without plans if there is no valid plan at all.
    """
    began = clock()
    form = _in_arcs(cycle)
    if form is not None:
        found = arc_cycle(form, solve)
    elif executor is None:
        with ThreadPoolExecutor(max_workers=1) as thread:
            found = route_cycle(cycle, solve, thread, clock)
    else:
        found = route_cycle(cycle, solve, executor, clock)
    chosen, status, reason = _choose(found)
    energy = None
    carriers: tuple[CarrierSummary, ...] = ()
    accounts: tuple[VehicleAccount, ...] = ()
    energies: dict[str, PlanEnergy] = {}
    baseline = found.baseline if isinstance(found.baseline, Candidate) else None
    if chosen is not None:
        energies = plan_energies(cycle.problem, chosen, baseline, cycle.commitments)
    if chosen is not None and baseline is not None:
        name = f"{found.baseline_solver}, without platooning"
        price_kw = cycle.problem.price_of_time_kw
        energy = summarise(name, baseline.energies, chosen.energies, price_kw)
        carriers = _by_carrier(cycle.problem.fleet, baseline, chosen)
        accounts = vehicle_accounts(cycle.problem, chosen, baseline)
    plans = () if chosen is None else chosen.plans
    if cycle.commitments:
        settings = cycle.settings
        plans = plans_to_send(plans, cycle.commitments, settings.sync_window_s, settings.interval_s)
    report = CycleReport.model_validate(
        {
            "cycle": cycle.number,
            "started_ns": cycle.now_ns,
            "wall_s": max(0.0, clock() - began),
            "status": status,
            "reason": reason,
            "solver": None if chosen is None else chosen.solver,
            "objective_kwh": None if chosen is None else chosen.objective_kwh,
            "variables": found.variables,
            "solvers": found.reports,
            "gates": cycle.snapshot.gates(),
            "energy": energy,
            "plans": len(plans),
            "unserved": tuple(Unserved(stop=s, reason=r) for s, r in found.unserved.items()),
            "carriers": carriers,
        }
    )
    joined = {} if chosen is None else chosen.joined
    refused = _refused(cycle, chosen, found)
    return CycleResult(report, plans, found.stops, joined, accounts, refused, energies)


def _refused(
    cycle: Cycle, chosen: Candidate | None, found: FormResult
) -> tuple[RefusedPlatoon, ...]:
    """Refused platoons; a fault here does not cost the plan."""
    try:
        return () if chosen is None else refused_platoons(cycle, chosen, found.declined)
    except Exception as error:
        log.exception("refused platoons of cycle %d are not known: %s", cycle.number, error)
        return ()


def _by_carrier(fleet: Fleet, baseline: Candidate, chosen: Candidate) -> tuple[CarrierSummary, ...]:

    def own(plan: Candidate, carrier: str | None) -> list[RouteEnergy]:
        of_routes = zip(plan.routes, plan.energies, strict=True)
        vehicles = fleet.vehicle_by_id
        return [e for route, e in of_routes if vehicles[route.vehicle].carrier == carrier]

    return tuple(
        CarrierSummary(
            carrier=carrier,
            baseline_kwh=total(e.undrafted for e in own(baseline, carrier)).total_kwh,
            cooperative_kwh=total(e.driven for e in own(chosen, carrier)).total_kwh,
            saved_cost_kwh=gain_kwh,
        )
        for carrier, gain_kwh in chosen.gains_kwh.items()
    )


def form_of(settings: DispatcherSettings, fleet: Fleet) -> Literal["arc", "route"]:
    """The form that a fleet is dispatched in.

    Raises:
        InputError: the settings ask for the arc form, and it cannot express the fleet.
    """
    obstacle = arc_form_obstacle(fleet)
    if settings.form == "arc" and obstacle is not None:
        raise InputError(
            settings.fleet, f"not for the arc form: {obstacle}", "take 'route'", key="form"
        )
    if settings.form != "auto":
        return settings.form
    few = len(fleet.vehicles) <= MAX_ARC_VEHICLES and len(fleet.stops) <= MAX_ARC_STOPS
    return "arc" if few and obstacle is None else "route"


def _in_arcs(cycle: Cycle) -> ArcForm | None:
    """The arc form of a cycle, without stops that no vehicle can serve; None: the route form."""
    if cycle.commitments or form_of(cycle.settings, cycle.problem.fleet) == "route":
        return None
    smaller, missing = servable_part(cycle.problem, cycle.snapshot)
    if smaller is None or arc_form_obstacle(smaller.fleet) is not None:
        return None
    return arc_form(replace(cycle, problem=smaller), missing)


def _choose(found: FormResult) -> tuple[Candidate | None, str, str | None]:
    """(the best plan, status, reason)."""
    chosen = min(found.candidates, key=lambda c: c.objective_kwh, default=None)
    fallback = found.fallback if isinstance(found.fallback, Candidate) else None
    if chosen is not None:
        # In the arc form, platoons that a solver assumes may not form.
        if fallback is None or fallback.objective_kwh >= chosen.objective_kwh - 1e-9:
            return chosen, "ok", None
        return fallback, "baseline", f"no solver's plan is better than {found.baseline_solver}'s"
    answers = "; ".join(f"{r.solver}: {r.reason or r.status}" for r in found.reports)
    if isinstance(found.fallback, CandidateRefusal):
        return None, "failed", f"no valid plan ({answers}; baseline: {found.fallback.reason})"
    return found.fallback, "baseline", f"no solver gave a valid plan ({answers})"


def cycle_of(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    settings: DispatcherSettings,
    number: int = 0,
    *,
    seed: int | None = None,
    reference_delay_s: float | None = None,
    on_road: tuple[RoadUser, ...] = (),
    start: Mapping[str, Sequence[str]] | None = None,
    commitments: tuple[Commitment, ...] = (),
) -> Cycle:
    """A cycle at the moment that its traffic is judged for.

    Args:
        number: of the cycle; 0: it is none of the dispatcher's.
        seed: of everything random in it; None: by the settings' seed and the number.
    """
    return Cycle(
        problem,
        snapshot,
        settings,
        number,
        snapshot.now_ns,
        cycle_seed(settings.seed, number) if seed is None else seed,
        reference_delay_s,
        on_road,
        start,
        commitments,
    )


def cycle_seed(seed: int, cycle: int) -> int:
    """Seed of one cycle, from the dispatcher's seed and the cycle's number."""
    return int(np.random.SeedSequence([seed, cycle]).generate_state(1)[0])

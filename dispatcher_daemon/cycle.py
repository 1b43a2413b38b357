"""One dispatch cycle as a function: traffic, fleet and time in; verified plans and a report out."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Final, Literal

from dispatcher_daemon.arc_form.cycle import ArcCycle
from dispatcher_daemon.fleet import Fleet, arc_form_obstacle
from dispatcher_daemon.planning.cycle import route_cycle
from dispatcher_daemon.planning.servability import servable_part
from dispatcher_daemon.plans.candidates import Candidate, Cycle, Found
from dispatcher_daemon.plans.energy import summarise
from dispatcher_daemon.platooning.platoons import Passage, Place
from dispatcher_daemon.platooning.rewards import JudgedPair
from dispatcher_daemon.platooning.vehicles_on_road import RoadUser
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads.routes import RoutedArc
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.pool import Solve
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.errors import InputError
from slipstream.messages import CycleReport, Unserved, VehiclePlan

MOST_ARC_VEHICLES: Final = 2
MOST_ARC_STOPS: Final = 8
"""A larger fleet is dispatched in route form, unless the settings say otherwise."""


@dataclass(frozen=True)
class CycleResult:
    """What one cycle gives.

    Attributes:
        report: for the dashboard and the database.
        plans: verified plans, one for each vehicle that drives; none if the cycle failed.
        arcs: the candidate arcs of the arc form.
        judged: every pair of arcs that share a watched segment, and why it platoons or not.
        stops: by vehicle, of the route form's plan, for the next cycle to start from.
        joined: places of vehicles on the road in platoons with vehicles of these plans.
    """

    report: CycleReport
    plans: tuple[VehiclePlan, ...]
    arcs: tuple[RoutedArc, ...] = ()
    judged: tuple[JudgedPair, ...] = ()
    stops: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    joined: Mapping[Passage, Place] = field(default_factory=dict)


def run_cycle(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    settings: DispatcherSettings,
    solve: Solve,
    now_ns: int,
    cycle: int,
    seed: int,
    clock: Callable[[], float] = time.monotonic,
    *,
    executor: Executor | None = None,
    start: Mapping[str, Sequence[str]] | None = None,
    reference_s: float | None = None,
    on_road: Sequence[RoadUser] = (),
) -> CycleResult:
    """Run one dispatch cycle.

    Same input, same seed and a `solve` that keeps to them give the same result, wall times aside.

    Args:
        problem: roads and fleet.
        snapshot: traffic at ``now_ns``.
        solve: runs solvers by name, within the deadline, without raising.
        now_ns: UTC at the start of the cycle.
        cycle: its number.
        seed: for everything random in the solvers.
        clock: seconds, for the report's wall time only.
        executor: for the search of the route form's base routes; None: this thread.
        start: routes by vehicle that this search starts from, as of the last cycle.
        reference_s: from the start of the cycle to the moment that the fleet's times count from;
            None: its deadline, so that plans are out before anybody leaves.
        on_road: vehicles that earlier cycles sent. The route form plans to meet them; they stay
            as they are, but for their places in platoons.

    Returns:
        The best verified plans of the solvers that answered; the baseline's if none did; a report
        of status "failed" without plans if there is no valid plan at all.
    """
    began = clock()
    if reference_s is None:
        reference_s = settings.deadline_s
    this = Cycle(problem, snapshot, settings, cycle, now_ns, seed, reference_s, tuple(on_road))
    arcs: tuple[RoutedArc, ...] = ()
    judged: tuple[JudgedPair, ...] = ()
    in_arcs = _in_arcs(this)
    if in_arcs is not None:
        smaller, missing = in_arcs
        arc_form = ArcCycle(replace(this, problem=smaller))
        found = replace(arc_form.run(solve), unserved=missing)
        arcs, judged = arc_form.parts.arcs, arc_form.parts.judged
    elif executor is None:
        with ThreadPoolExecutor(max_workers=1) as thread:
            found = route_cycle(this, solve, thread, start)
    else:
        found = route_cycle(this, solve, executor, start)
    chosen, status, reason = _choose(found)
    energy = None
    if chosen is not None and isinstance(found.alone, Candidate):
        name = f"{found.baseline}, without platooning"
        energy = summarise(name, found.alone.energies, chosen.energies)
    report = CycleReport.model_validate(
        {
            "cycle": cycle,
            "started_ns": now_ns,
            "wall_s": max(0.0, clock() - began),
            "status": status,
            "reason": reason,
            "solver": None if chosen is None else chosen.solver,
            "objective_kwh": None if chosen is None else chosen.objective_kwh,
            "variables": found.variables,
            "solvers": found.reports,
            "gates": snapshot.gates(),
            "energy": energy,
            "plans": 0 if chosen is None else len(chosen.plans),
            "unserved": tuple(Unserved(stop=s, reason=r) for s, r in found.unserved.items()),
        }
    )
    plans = () if chosen is None else chosen.plans
    joined = {} if chosen is None else chosen.joined
    return CycleResult(report, plans, arcs, judged, found.stops, joined)


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
    few = len(fleet.vehicles) <= MOST_ARC_VEHICLES and len(fleet.stops) <= MOST_ARC_STOPS
    return "arc" if few and obstacle is None else "route"


def _in_arcs(cycle: Cycle) -> tuple[RoutingProblem, dict[str, str]] | None:
    """What the arc form gets, and the stops left out with the reason; None for the route form."""
    settings, problem = cycle.settings, cycle.problem
    if form_of(settings, problem.fleet) == "route":
        return None
    smaller, missing = servable_part(problem, cycle.snapshot)
    if smaller is None or arc_form_obstacle(smaller.fleet) is not None:
        return None
    return smaller, missing


def _choose(found: Found) -> tuple[Candidate | None, str, str | None]:
    """(the best plan, status, reason)."""
    chosen = min(found.candidates, key=lambda c: c.objective_kwh, default=None)
    fallback = found.fallback if isinstance(found.fallback, Candidate) else None
    if chosen is not None and fallback is not None:
        # In the arc form, platoons that a solver counts on may not come about.
        if fallback.objective_kwh < chosen.objective_kwh - 1e-9:
            return fallback, "baseline", f"no solver's plan is better than {found.baseline}'s"
        return chosen, "ok", None
    if chosen is not None:
        return chosen, "ok", None
    said = "; ".join(f"{r.solver}: {r.reason or r.status}" for r in found.reports)
    if fallback is not None:
        return fallback, "baseline", f"no solver gave a valid plan ({said})"
    return None, "failed", f"no valid plan ({said}; baseline: {found.fallback})"

"""An instance as the cycle that a dispatcher would run on it, in either form, and answers to it."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Final

from dispatcher_daemon.planning.arc_form import ArcForm, arc_form, arc_form_obstacle
from dispatcher_daemon.planning.cycle import cycle_of
from dispatcher_daemon.planning.plans import Candidate, CandidateRefusal, Cycle
from dispatcher_daemon.planning.route_form import BASE
from dispatcher_daemon.planning.routes import servable_part
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers import Outcome, cheapest_insertion
from dispatcher_daemon.solvers.workers import Solve
from slipstream.errors import InputError
from slipstream_lab.research.instances.instance import Instance
from slipstream_lab.research.instances.route_form import RouteForm, route_form

DEFAULT_SETTINGS: Final = DispatcherSettings()
Form = ArcForm | RouteForm


@dataclass(frozen=True)
class Attempt:
    """One solver's outcome, and its verified plans or why there are none."""

    outcome: Outcome
    result: Candidate | CandidateRefusal

    @property
    def candidate(self) -> Candidate | None:
        """The verified plans, if there are any."""
        return self.result if isinstance(self.result, Candidate) else None

    @property
    def faults(self) -> tuple[str, ...]:
        """Why there are none."""
        return self.result.faults if isinstance(self.result, CandidateRefusal) else ()


def attempt(form: Form, outcome: Outcome) -> Attempt:
    """The verified plans of an outcome, or why there are none."""
    if outcome.selected is None:
        return Attempt(outcome, CandidateRefusal((outcome.reason or outcome.status,)))
    return Attempt(outcome, form.candidate(outcome.solver, outcome.selected))


def references_kwh(form: Form) -> dict[str, float]:
    """Objectives of reference heuristics, by name, kWh: cheapest insertion; routes without
    platooning, and departures chosen for them afterwards.
    """
    if isinstance(form, RouteForm):
        first = form.first
        return {
            "without platooning": first.base.objective_kwh,
            "route, then schedule": first.greedy.objective_kwh,
        }
    selected = cheapest_insertion(form.problem)
    plan = None if selected is None else form.candidate("insertion", selected)
    return {"insertion": plan.objective_kwh} if isinstance(plan, Candidate) else {}


def baseline(
    form: Form, solve: Solve, deadline_s: float
) -> tuple[str, Candidate | CandidateRefusal]:
    """Solver of the plan without platooning, and that plan: in the arc form the exact one, or the
    best found in time.
    """
    if isinstance(form, RouteForm):
        return BASE, form.baseline()
    (outcome,) = solve([form.baseline_job], deadline_s)
    name, selected = form.baseline_answer(outcome)
    if selected is None:
        return name, CandidateRefusal(("no plan found",))
    return name, form.candidate(name, selected, platooning=False)


def instance_cycle(
    instance: Instance, seed: int, settings: DispatcherSettings = DEFAULT_SETTINGS
) -> Cycle:
    """Cycle 0 in the instance's traffic; times count from its start, no deadline holds."""
    settings = settings.model_copy(update={"sync_window_s": instance.sync_window_s})
    return cycle_of(instance.problem, instance.snapshot, settings, seed=seed, reference_delay_s=0.0)


def arc_form_of(
    instance: Instance, seed: int = 1, settings: DispatcherSettings = DEFAULT_SETTINGS
) -> ArcForm:
    """The arc form of an instance; stops that no vehicle can serve are left out. Raises
    InputError: the arc form cannot express the fleet, or no stop can be served.
    """
    cycle = instance_cycle(instance, seed, settings)
    routing, unserved = servable_part(cycle.problem, cycle.snapshot)
    if routing is None:
        raise _no_servable_stop(instance, unserved)
    obstacle = arc_form_obstacle(routing.fleet)
    if obstacle is not None:
        raise InputError(instance.name, f"not for the arc form: {obstacle}", "take --form route")
    return arc_form(replace(cycle, problem=routing), unserved)


def route_form_of(
    instance: Instance, seed: int = 1, settings: DispatcherSettings = DEFAULT_SETTINGS
) -> RouteForm:
    """The route form of an instance: all its vehicles as one block. Raises InputError: no stop can
    be served.
    """
    with ThreadPoolExecutor(max_workers=1) as executor:
        form = route_form(instance_cycle(instance, seed, settings), executor)
    if not form.problem.choices:
        raise _no_servable_stop(instance, form.unserved)
    return form


def _no_servable_stop(instance: Instance, missing: Mapping[str, str]) -> InputError:
    why = "; ".join(f"{stop}: {reason}" for stop, reason in list(missing.items())[:3])
    return InputError(
        instance.name,
        f"no stop can be served ({why})",
        "mend the fleet or the network",
        key="fleet.stops",
    )

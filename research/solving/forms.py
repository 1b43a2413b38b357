"""An instance in arc or route form: what solvers get, and what their selections mean on roads."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol

from dispatcher_daemon.arc_form.arcs import ArcParts, arc_parts_of
from dispatcher_daemon.fleet import arc_form_obstacle
from dispatcher_daemon.formulations.decode import decode
from dispatcher_daemon.planning.servability import servable_part
from dispatcher_daemon.planning.sweeps import choice_of
from dispatcher_daemon.platooning.rewards import JudgedPair, judge_pairs
from dispatcher_daemon.problem import ArcProblem, Problem, RouteProblem, RoutingProblem
from dispatcher_daemon.roads.routes import Route, RoutedArc, timetable
from dispatcher_daemon.settings import CitySettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.insertion import cheapest_insertion
from dispatcher_daemon.traffic import TrafficSnapshot
from research.instances.instance import Instance
from research.solving.route_form import RouteForm, route_problem_of
from slipstream.errors import InputError

FormName = Literal["arc", "route"]


class Form(Protocol):
    """An instance as a problem for solvers."""

    @property
    def name(self) -> FormName:
        """Which form it is."""
        ...

    @property
    def routing(self) -> RoutingProblem:
        """Roads and fleet behind it, without stops that nobody serves in the arc form."""
        ...

    @property
    def problem(self) -> Problem:
        """What solvers get."""
        ...

    @property
    def unserved(self) -> Mapping[str, str]:
        """Reason by stop that is not served."""
        ...

    @property
    def arcs(self) -> Sequence[RoutedArc]:
        """The legs that vehicles may drive, with their times."""
        ...

    @property
    def judged(self) -> Sequence[JudgedPair]:
        """Every pair of them on a watched segment, with its reward or the reason why it is 0."""
        ...

    def objective_kwh(self, selected: Collection[int]) -> float:
        """H_cost − H_platoon of a valid selection, platoons of three and more counted right."""
        ...

    def routes(self, selected: Collection[int]) -> list[Route]:
        """Timetables of a valid selection; vehicles that stay idle have none."""
        ...

    def rivals_kwh(self) -> dict[str, float]:
        """Objectives of plans by simpler means, by what made them."""
        ...

    def baseline(self, deadline_s: float, seed: int) -> tuple[str, list[Route]] | None:
        """The plan without platooning, and what made it; None if there is none in time."""
        ...


@dataclass(frozen=True)
class ArcForm:
    """The paper's arc form; every vehicle leaves when it is ready."""

    routing: RoutingProblem
    unserved: Mapping[str, str]
    parts: ArcParts
    name: FormName = "arc"

    @property
    def problem(self) -> ArcProblem:
        """See `Form`."""
        return self.parts.problem

    @property
    def arcs(self) -> tuple[RoutedArc, ...]:
        """See `Form`."""
        return self.parts.arcs

    @property
    def judged(self) -> tuple[JudgedPair, ...]:
        """See `Form`."""
        return self.parts.judged

    def objective_kwh(self, selected: Collection[int]) -> float:
        """See `Form`; with two vehicles pairs are all there is."""
        return self.problem.objective_kwh(selected)

    def rivals_kwh(self) -> dict[str, float]:
        """See `Form`: cheapest insertion."""
        selected = cheapest_insertion(self.problem)
        return {} if selected is None else {"insertion": self.objective_kwh(selected)}

    def routes(self, selected: Collection[int]) -> list[Route]:
        """See `Form`.

        Raises:
            ValueError: the selection is not valid.
        """
        decoded = decode(self.problem, selected)
        if decoded.routes is None:
            raise ValueError(decoded.violations[0])
        return [
            timetable(self.routing, self.parts.legs, vehicle, decoded.routes[vehicle.id])
            for vehicle in self.routing.fleet.vehicles
        ]

    def baseline(self, deadline_s: float, seed: int) -> tuple[str, list[Route]] | None:
        """See `Form`: the exact optimum with H_platoon = 0, or the best found in time."""
        outcome = ExactSolver().solve(self.problem.without_platooning(), deadline_s, seed)
        if outcome.selected is None:
            return None
        return f"{outcome.solver}, without platooning", self.routes(outcome.selected)


@dataclass(frozen=True)
class RouteOptions:
    """The route form: all driving vehicles, each with its options."""

    routing: RoutingProblem
    snapshot: TrafficSnapshot
    form: RouteForm
    name: FormName = "route"

    @property
    def problem(self) -> RouteProblem:
        """See `Form`."""
        return self.form.block.problem

    @property
    def unserved(self) -> Mapping[str, str]:
        """See `Form`."""
        return self.form.unserved

    @cached_property
    def arcs(self) -> tuple[RoutedArc, ...]:
        """See `Form`: the legs of all options."""
        legs: dict[tuple[str, tuple[str, ...], float], RoutedArc] = {}
        for options in self.form.block.options.values():
            for route in (option.route for option in options if option.route is not None):
                for leg, visit in zip(route.legs, route.visits, strict=False):
                    key = (route.vehicle, leg.path, visit.departure_s)
                    arc = RoutedArc(route.vehicle, leg, visit.departure_s, exact=True)
                    legs.setdefault(key, arc)
        return tuple(legs.values())

    @cached_property
    def judged(self) -> tuple[JudgedPair, ...]:
        """See `Form`."""
        window_s = self.form.planner.sync_window_s
        return tuple(judge_pairs(self.routing, self.arcs, self.snapshot, window_s))

    def objective_kwh(self, selected: Collection[int]) -> float:
        """See `Form`; evaluated from nothing, as the model's is an expansion."""
        chosen = self.form.block.chosen(frozenset(selected))
        return choice_of(self.form.planner, chosen).objective_kwh

    def routes(self, selected: Collection[int]) -> list[Route]:
        """See `Form`."""
        chosen = self.form.block.chosen(frozenset(selected))
        return [option.route for option in chosen if option.route is not None]

    def rivals_kwh(self) -> dict[str, float]:
        """See `Form`: routes without platooning, and departures chosen for them afterwards."""
        return {
            "without platooning": self.form.base.objective_kwh,
            "route, then schedule": self.form.greedy.objective_kwh,
        }

    def baseline(self, deadline_s: float, seed: int) -> tuple[str, list[Route]] | None:
        """See `Form`: base routes, everybody leaving when ready."""
        routes = [i.route for i in self.form.base.itineraries if i.route is not None]
        return "PyVRP, without platooning", routes


def route_form(instance: Instance, options: int, seed: int) -> RouteOptions:
    """The route form of an instance.

    Args:
        options: most of each vehicle.
        seed: of the search for base routes and of the draw of options.

    Raises:
        InputError: no stop can be served.
    """
    form = route_problem_of(
        instance.problem,
        instance.snapshot,
        CitySettings(options=options),
        sync_window_s=instance.sync_window_s,
        seed=seed,
    )
    if not form.block.problem.choices:
        raise _nothing_to_do(instance, form.unserved)
    return RouteOptions(instance.problem, instance.snapshot, form)


def arc_form(instance: Instance) -> ArcForm:
    """The arc form of an instance; stops that nobody can serve are left out.

    Raises:
        InputError: the arc form cannot express the fleet, or no stop can be served.
    """
    routing, unserved = servable_part(instance.problem, instance.snapshot)
    if routing is None:
        raise _nothing_to_do(instance, unserved)
    obstacle = arc_form_obstacle(routing.fleet)
    if obstacle is not None:
        raise InputError(instance.name, f"not for the arc form: {obstacle}", "take --form route")
    parts = arc_parts_of(routing, instance.snapshot, instance.sync_window_s)
    return ArcForm(routing, unserved, parts)


def _nothing_to_do(instance: Instance, missing: Mapping[str, str]) -> InputError:
    why = "; ".join(f"{stop}: {reason}" for stop, reason in list(missing.items())[:3])
    return InputError(
        instance.name,
        f"no stop can be served ({why})",
        "mend the fleet or the network",
        key="fleet.stops",
    )

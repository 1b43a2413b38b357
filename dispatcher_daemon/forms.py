"""An instance in arc or route form: what solvers get, and what their selections mean on roads."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

from dispatcher_daemon.decode import decode
from dispatcher_daemon.dispatch import arc_problem
from dispatcher_daemon.fleet import arc_form_obstacle
from dispatcher_daemon.instance import Instance
from dispatcher_daemon.problem import ArcProblem, Problem, RoutingProblem
from dispatcher_daemon.rewards import JudgedPair, judge_pairs
from dispatcher_daemon.routability import unservable
from dispatcher_daemon.routes import (
    Leg,
    Route,
    RoutedArc,
    candidate_arcs,
    least_energy_legs,
    timetable,
)
from dispatcher_daemon.solvers.exact import ExactSolver
from slipstream.errors import InputError

FormName = Literal["arc", "route"]


class Form(Protocol):
    """An instance as a problem for solvers."""

    @property
    def name(self) -> FormName:
        """Which form it is."""
        ...

    @property
    def problem(self) -> Problem:
        """What solvers get."""
        ...

    @property
    def arcs(self) -> Sequence[RoutedArc]:
        """The legs that vehicles may drive, with their times."""
        ...

    @property
    def judged(self) -> Sequence[JudgedPair]:
        """Every pair of them on a watched segment, with its reward or the reason why it is 0."""
        ...

    def routes(self, selected: Collection[int]) -> list[Route]:
        """Timetables of a valid selection; vehicles that stay idle have none."""
        ...

    def baseline(self, deadline_s: float, seed: int) -> tuple[str, list[Route]] | None:
        """The plan without platooning, and what made it; None if there is none in time."""
        ...


@dataclass(frozen=True)
class ArcForm:
    """The paper's arc form; every vehicle leaves when it is ready."""

    routing: RoutingProblem
    problem: ArcProblem
    arcs: tuple[RoutedArc, ...]
    judged: tuple[JudgedPair, ...]
    legs: Mapping[tuple[str, str], Leg]
    name: FormName = "arc"

    def routes(self, selected: Collection[int]) -> list[Route]:
        """See `Form`.

        Raises:
            ValueError: the selection is not valid.
        """
        decoded = decode(self.problem, selected)
        if decoded.routes is None:
            raise ValueError(decoded.violations[0])
        return [
            timetable(self.routing, self.legs, vehicle, decoded.routes[vehicle.id])
            for vehicle in self.routing.fleet.vehicles
        ]

    def baseline(self, deadline_s: float, seed: int) -> tuple[str, list[Route]] | None:
        """See `Form`: the exact optimum with H_platoon = 0, or the best found in time."""
        outcome = ExactSolver().solve(self.problem.without_platooning(), deadline_s, seed)
        if outcome.selected is None:
            return None
        return f"{outcome.solver}, without platooning", self.routes(outcome.selected)


def arc_form(routing: RoutingProblem, instance: Instance) -> ArcForm:
    """The arc form of an instance's problem, or of a part of it.

    Raises:
        InputError: the arc form cannot express the fleet.
    """
    obstacle = arc_form_obstacle(routing.fleet)
    if obstacle is not None:
        raise InputError(instance.name, f"not for the arc form: {obstacle}", "take --form route")
    legs = least_energy_legs(routing, instance.snapshot)
    arcs = candidate_arcs(routing, legs)
    judged = tuple(judge_pairs(routing, arcs, instance.snapshot, instance.sync_window_s))
    return ArcForm(routing, arc_problem(routing, arcs, judged), arcs, judged, legs)


def servable_part(instance: Instance) -> tuple[RoutingProblem, dict[str, str]]:
    """The problem without stops that nobody can serve, and these with the reason.

    A vehicle whose first stop is among them has none.

    Raises:
        InputError: nobody can serve any stop.
    """
    problem = instance.problem
    missing = unservable(problem, instance.snapshot)
    if not missing:
        return problem, {}
    fleet = problem.fleet
    stops = tuple(stop for stop in fleet.stops if stop.id not in missing)
    if not stops:
        stop, reason = next(iter(missing.items()))
        raise InputError(
            instance.name,
            f"no stop can be served ({stop}: {reason})",
            "mend the fleet or the network",
            key="fleet.stops",
        )
    vehicles = tuple(
        v.model_copy(update={"first_stop": None}) if v.first_stop in missing else v
        for v in fleet.vehicles
    )
    smaller = type(fleet)(name=fleet.name, depots=fleet.depots, stops=stops, vehicles=vehicles)
    return replace(problem, fleet=smaller), missing

"""The route form of a small fleet in one piece: all driving vehicles as one block."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np

from dispatcher_daemon.forms import RouteProblem, violations
from dispatcher_daemon.planning.improvement import (
    Block,
    add_discounted_ways,
    best_exchanges,
    build_block,
    choice_of,
    nobody_worse_off,
    options_for,
)
from dispatcher_daemon.planning.plans import Candidate, CandidateRefusal, Cycle
from dispatcher_daemon.planning.platooning import JudgedPair, judge_pairs
from dispatcher_daemon.planning.roads import RoutedArc
from dispatcher_daemon.planning.route_form import (
    BASE,
    NO_ROOM,
    InitialPlans,
    first_routes,
    initial_plans,
    servable,
    with_ways,
)


@dataclass(frozen=True)
class RouteForm:
    """A fleet as one problem for solvers, and the plans of their selections.

    Attributes:
        first: plans before the block is solved; the first option of each vehicle is the better one.
        block: `block.problem` is for solvers, `block.chosen` reads their answers.
    """

    cycle: Cycle
    unserved: Mapping[str, str]
    first: InitialPlans
    block: Block
    name: Literal["route"] = "route"

    @property
    def problem(self) -> RouteProblem:
        """What solvers get."""
        return self.block.problem

    @cached_property
    def arcs(self) -> tuple[RoutedArc, ...]:
        """The legs of all options."""
        legs: dict[tuple[str, tuple[str, ...], float], RoutedArc] = {}
        for options in self.block.options.values():
            for route in (option.route for option in options if option.route is not None):
                for leg, visit in zip(route.legs, route.visits, strict=False):
                    key = (route.vehicle, leg.path, visit.departure_s)
                    arc = RoutedArc(route.vehicle, leg, visit.departure_s, exact=True)
                    legs.setdefault(key, arc)
        return tuple(legs.values())

    @cached_property
    def judged(self) -> tuple[JudgedPair, ...]:
        """Every pair of legs on a watched segment, with its reward or the reason why it is 0."""
        cycle = self.cycle
        window_s = cycle.settings.sync_window_s
        return tuple(judge_pairs(cycle.problem, self.arcs, cycle.snapshot, window_s))

    def candidate(self, solver: str, selected: frozenset[int]) -> Candidate | CandidateRefusal:
        """The verified plans of a selection of options; its objective is evaluated from nothing, as
        the block's is an expansion.
        """
        if not all(0 <= index < self.problem.choices for index in selected):
            return CandidateRefusal(("not a selection of options",))
        faults = violations(self.problem, selected)
        if faults:
            return CandidateRefusal(tuple(faults))
        planner, base = self.first.planner, self.first.base.itineraries
        chosen = {i.number: i for i in self.block.chosen(selected)}
        present = [chosen.get(i.number, i) for i in base]
        accounts = nobody_worse_off(planner, base, present, self.cycle.on_road)
        choice = choice_of(planner, present if accounts is None else accounts.present)
        gains = None if accounts is None else accounts.gains_kwh()
        return self.cycle.candidate(
            solver, choice.routes, choice.objective_kwh, unserved=self.unserved, gains_kwh=gains
        )

    def baseline(self) -> Candidate | CandidateRefusal:
        """The plan without platooning: base routes, all vehicles leaving when ready."""
        base = self.first.base
        return self.cycle.candidate(
            BASE, base.routes, base.cost_kwh, platooning=False, unserved=self.unserved
        )


def route_form(cycle: Cycle, executor: Executor) -> RouteForm:
    """Base routes, greedy departures, up to `city.options` options of each vehicle, and the best
    exchanges of stops between each two.

    Savings are expanded around the greedy plan (`blocks.build_block`).

    Args:
        executor: for the search of base routes.
    """
    settings = cycle.settings.city
    cycle, travel = with_ways(cycle)
    part, travel, missing = servable(cycle, travel)
    routes = first_routes(part, travel, missing, settings.search, executor)
    missing |= dict.fromkeys(routes.unassigned, NO_ROOM)
    first = initial_plans(part, travel, routes.stops, missing)
    planner = first.planner
    add_discounted_ways(planner)
    meetings = planner.book.meetings()
    for itinerary in first.best.itineraries:
        meetings.add(itinerary.traversals)
    driving = [i for i in first.best.itineraries if i.route is not None]
    rng = np.random.default_rng(cycle.seed)
    options = {
        i.number: options_for(planner, i, driving, meetings, settings.options, rng) for i in driving
    }
    free = [i for i in driving if i.number not in planner.windows.bound]
    for one, other in combinations(free, 2):
        for pair in best_exchanges(planner, (one, other), meetings, settings.options - 1, rng):
            for itinerary in pair:
                of_one = options[itinerary.number]
                if all(itinerary.key != known.key for known in of_one):
                    of_one.append(itinerary)
    names = {n: v.id for n, v in enumerate(cycle.problem.fleet.vehicles)}
    return RouteForm(cycle, missing, first, build_block(names, options, meetings))

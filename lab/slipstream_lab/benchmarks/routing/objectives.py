"""The objective "energy" beside the paper's, on generated cities: energy and driving time of plans,
and what drafting could save at most.

python -m slipstream_lab.benchmarks.routing.objectives [--cities 20] [--out FILE.json]
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final, Literal

from dispatcher_daemon.fleet import Passage
from dispatcher_daemon.planning.improvement import Choice
from dispatcher_daemon.planning.plans import route_energy
from dispatcher_daemon.planning.platooning import Place, expected_drafting, form_platoons
from dispatcher_daemon.planning.roads import RoadLeg, Route, leg_along, roads_of
from dispatcher_daemon.planning.route_form import plan_fleet
from dispatcher_daemon.settings import CitySettings, DispatcherSettings
from slipstream_lab.benchmarks.routing.city_run import workers
from slipstream_lab.research.cities.generator import generate_city
from slipstream_lab.research.instances.forms import instance_cycle
from slipstream_lab.research.instances.instance import Instance

PRICES_KW: Final = (0.0, 1.0, 2.0, 5.0)
"""Of driving time, for the objective "energy"."""
WINDOWS_S: Final = (60.0, 600.0)
"""Within which all who come to a segment with an open gate are one platoon, for a ceiling: a minute
is what can be made up for on the way, ten the least departure window of a generated city."""
_BUDGET_S: Final = 60.0
_FOLLOWER: Final = Place("", 1, 2)


@dataclass(frozen=True)
class RoutingPlan:
    """One plan of one city.

    Attributes:
        hours: on the road, expected stops included; of `alone_kwh`: `alone_hours`.
        ceilings_kwh: of the routes without platooning, if vehicles were close at once in platoons
            of all who come to an open segment within each of `WINDOWS_S`; then, if all followed
            wherever the gate is open; then, if all followed everywhere.
    """

    seed: int
    objective: Literal["energy", "paper"]
    price_kw: float
    kwh: float
    alone_kwh: float
    hours: float
    alone_hours: float
    objective_saving: float
    ceilings_kwh: tuple[float, ...]


def plan(seed: int, objective: Literal["energy", "paper"], price_kw: float) -> RoutingPlan:
    """Plan one city of 40 vehicles under an objective; both are measured alike."""
    drawn = generate_city(seed, vehicles=40, stops=200, segments=400)
    problem = replace(drawn.problem, objective=objective, price_of_time_kw=price_kw)
    city, settings = replace(drawn, problem=problem), CitySettings()
    cycle_settings = DispatcherSettings(
        city=settings,
        solvers=settings.solvers,
        deadline_s=_BUDGET_S,
        interval_s=2 * _BUDGET_S,
    )
    with workers(settings) as (executor, solve):
        found = plan_fleet(instance_cycle(city, 1, cycle_settings), executor, solve)
    expected = expected_drafting(problem, city.snapshot)
    places = form_platoons(
        found.choice.routes,
        city.snapshot,
        city.sync_window_s,
        problem.longest_platoon,
        1,
        expected=expected,
    )
    base = exact_drives(city, found.base)
    driven, alone = (
        measured(city, exact_drives(city, found.choice), places),
        measured(city, base, {}),
    )
    saving = 1 - found.choice.objective_kwh / found.base.cost_kwh
    ceilings = ceilings_kwh(city, base)
    return RoutingPlan(
        seed, objective, price_kw, driven[0], alone[0], driven[1], alone[1], saving, ceilings
    )


def ceilings_kwh(city: Instance, drives: Sequence[Route]) -> tuple[float, ...]:
    """`RoutingPlan.ceilings_kwh` of the exact drives of routes without platooning."""
    segments = city.snapshot.segments
    open_or_not = {
        (route.vehicle, leg, position): segments[segment].open
        for route in drives
        for leg, position, segment, _, _ in route.entries_s()
    }
    together = [
        *(
            form_platoons(drives, city.snapshot, window_s, city.problem.longest_platoon, 1)
            for window_s in WINDOWS_S
        ),
        {passage: _FOLLOWER for passage, is_open in open_or_not.items() if is_open},
        dict.fromkeys(open_or_not, _FOLLOWER),
    ]
    return tuple(measured(city, drives, places)[0] for places in together)


def exact_drives(city: Instance, choice: Choice) -> tuple[Route, ...]:
    """A plan's routes by the exact drives of their paths, in the time that these are expected to
    take, whatever the plan was chosen by.
    """
    problem = replace(city.problem, objective="energy")
    roads = roads_of(problem, city.snapshot)

    def exact(leg: RoadLeg) -> RoadLeg:
        path = [roads.index[segment] for segment in leg.path]
        return leg_along(roads, path, leg.start, leg.end, problem.style) if path else leg

    return tuple(
        replace(route, legs=tuple(exact(leg) for leg in route.legs)) for route in choice.routes
    )


def measured(
    city: Instance, drives: Sequence[Route], places: Mapping[Passage, Place]
) -> tuple[float, float]:
    """(physical energy, kWh; time on the road, h) of exact drives. `places`: in platoons; of
    passages that are left out vehicles are alone.
    """
    energies = [route_energy(city.problem, route, places) for route in drives]
    return sum(e.driven.total_kwh for e in energies), sum(e.driving_s for e in energies) / 3600


def at_time(plans: Sequence[RoutingPlan], hours: float) -> float:
    """Energy of the objective "energy" at a driving time, by its prices; outside of their times
    that of the nearest one.
    """
    points = sorted((p.hours, p.kwh) for p in plans)
    if hours <= points[0][0]:
        return points[0][1]
    for (h0, e0), (h1, e1) in pairwise(points):
        if hours <= h1:
            return e0 + (e1 - e0) * (hours - h0) / (h1 - h0) if h1 > h0 else min(e0, e1)
    return points[-1][1]


def report(plans: Sequence[RoutingPlan]) -> str:
    """A row a city, and the means."""
    lines = [
        "| city | paper's, kWh | h | "
        + " | ".join(f"{p:g} kW, kWh | h" for p in PRICES_KW)
        + " | at equal time |",
        "|---|" + "--:|" * (3 + 2 * len(PRICES_KW)),
    ]
    below = []
    for seed in sorted({p.seed for p in plans}):
        (paper,) = [p for p in plans if p.seed == seed and p.objective == "paper"]
        ours = [p for p in plans if p.seed == seed and p.objective == "energy"]
        below.append(1 - at_time(ours, paper.hours) / paper.kwh)
        cells = " | ".join(f"{p.kwh:.3f} | {p.hours:.3f}" for p in ours)
        lines.append(
            f"| {seed} | {paper.kwh:.3f} | {paper.hours:.3f} | {cells} | {-below[-1]:+.1%} |"
        )
    lines.append("")
    lines.append(
        f"At the paper's driving time: {-statistics.mean(below):+.2%} in the mean, "
        f"{-max(below):+.2%} to {-min(below):+.2%}."
    )
    for price in PRICES_KW:
        ours = [p for p in plans if p.objective == "energy" and p.price_kw == price]
        physical = [1 - p.kwh / p.alone_kwh for p in ours]
        agree = sum(
            (p.objective_saving >= -1e-12)
            == (p.kwh + price * p.hours <= p.alone_kwh + price * p.alone_hours + 1e-9)
            for p in ours
        )
        lines.append(
            f"{price:g} kW: physical saving against the same without platooning "
            f"{statistics.mean(physical):.2%} ({min(physical):.2%} to {max(physical):.2%}), "
            f"objective and energy agree in {agree} of {len(ours)}."
        )
        most = [
            statistics.mean(1 - p.ceilings_kwh[n] / p.alone_kwh for p in ours)
            for n in range(len(WINDOWS_S) + 2)
        ]
        minutes = ", ".join(
            f"within {s / 60:g} min {share:.2%}" for s, share in zip(WINDOWS_S, most, strict=False)
        )
        lines.append(
            f"{price:g} kW: what drafting could save at most: {minutes}, everybody following "
            f"behind open gates {most[-2]:.2%}, everywhere {most[-1]:.2%}."
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Plan all cities, print the table."""
    parser = argparse.ArgumentParser(prog="python -m slipstream_lab.benchmarks.routing.objectives")
    parser.add_argument("--cities", type=int, default=20)
    parser.add_argument("--out", type=Path, help="JSON")
    options = parser.parse_args(arguments)
    plans = []
    for seed in range(1, options.cities + 1):
        plans.append(plan(seed, "paper", 0.0))
        plans += [plan(seed, "energy", price) for price in PRICES_KW]
        print(f"city {seed} of {options.cities}", file=sys.stderr, flush=True)
        if options.out is not None:
            options.out.write_text(json.dumps([asdict(p) for p in plans]))
    print(report(plans))


if __name__ == "__main__":
    main()

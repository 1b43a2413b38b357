"""Instances of the arc form by recipe and seed: roads, fleet and one moment of traffic."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, count, pairwise, permutations, product
from types import MappingProxyType
from typing import Final, Literal

import numpy as np

from dispatcher_daemon.fleet import DEPOT, Depot, Fleet, Stop, Vehicle
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.arc_form import arc_problem_of
from dispatcher_daemon.planning.roads import candidate_arcs, least_energy_legs
from dispatcher_daemon.traffic import SegmentTraffic, TrafficSnapshot
from slipstream.roads import RoadNetwork
from slipstream_lab.research.instances.landscapes import LANDSCAPES

GENERATOR_VERSION: Final = 1
"""Goes up when the same recipe and seed would give another instance."""

INSTANCE_TIME_NS: Final = 1_800_000_000_000_000_000
"""The moment that every generated instance is shown at, UTC."""

SYNC_WINDOW_S: Final = 3.0
_DRAWS: Final = 20_000
_MIN_GAP_KWH: Final = 1e-4
"""The best route set is better than the next one by at least this, with and without rewards."""

Stability = Literal["open", "closed", "mixed"]
_FLAGS: Final[Mapping[Stability, tuple[Literal[0, 1] | None, ...]]] = MappingProxyType(
    {"open": (1,), "closed": (0,), "mixed": (1, 1, 1, 1, 0, None)}
)


@dataclass(frozen=True)
class Recipe:
    """What kind of instance.

    Attributes:
        stability: y_e of the segments: all 1, all 0, or 1 on about two thirds and else 0 or
            unknown.
        ready_within_s: vehicles set out from there at some moment between the first possible one
            and this much later.
        meet: where the vehicles could set out together: at the depot, or at their first stops.
        flips: platooning must change the optimal routes (True), must not (False), or may (None).
    """

    landscape: str
    first_stops: tuple[bool, ...]
    pooled: int
    stability: Stability = "open"
    ready_within_s: float = 2.5
    meet: Literal["depot", "stops"] = "depot"
    flips: bool | None = None


@dataclass(frozen=True)
class GeneratedInstance:
    """A generated instance. `draw`: how many were drawn until one fitted the recipe, counted from
    0.
    """

    problem: RoutingProblem
    snapshot: TrafficSnapshot
    draw: int


def generate(recipe: Recipe, seed: int) -> GeneratedInstance:
    """The first instance of the seed's stream that fits the recipe; same arguments, same instance.
    Raises ValueError: fewer sites than stops, or none of the first 20,000 draws fits.
    """
    for draw in range(_DRAWS):
        problem, snapshot = _draw(recipe, np.random.default_rng([seed, draw]))
        if _fits(recipe, problem, snapshot):
            return GeneratedInstance(problem, snapshot, draw)
    raise ValueError(f"none of {_DRAWS} draws fits {recipe}")


def _fits(recipe: Recipe, problem: RoutingProblem, snapshot: TrafficSnapshot) -> bool:
    """Platooning changes the best route set or not, as the recipe wants, and there is only one.

    Vehicles without a first stop can swap their routes, so with two of them there are always two.
    """
    rewarded = arc_problem_of(problem, snapshot, SYNC_WINDOW_S)
    plain = rewarded.without_platooning()
    found = [rewarded.selection(routes) for routes in _route_sets(problem.fleet)]
    sets = [selection for selection in found if selection is not None]
    best = sorted(sets, key=rewarded.objective_kwh)[:2]
    alone = sorted(sets, key=plain.objective_kwh)[:2]
    unlike = recipe.first_stops.count(False) < 2
    if not best or any(
        unlike and arcs.objective_kwh(pair[-1]) - arcs.objective_kwh(pair[0]) < _MIN_GAP_KWH
        for arcs, pair in ((rewarded, best), (plain, alone))
        if len(pair) == 2
    ):
        return False
    return recipe.flips is None or (best[0] != alone[0]) == recipe.flips


def _route_sets(fleet: Fleet) -> Iterator[dict[str, tuple[str, ...]]]:
    """Every way to share the pooled stops out among the vehicles, in every order."""
    vehicles, pooled = fleet.vehicles, fleet.pooled
    for order in permutations(pooled):
        for cuts in combinations_with_replacement(range(len(pooled) + 1), len(vehicles) - 1):
            bounds = (0, *cuts, len(pooled))
            parts = [order[low:high] for low, high in pairwise(bounds)]
            routes = {
                v.id: (() if v.first_stop is None else (v.first_stop,)) + part
                for v, part in zip(vehicles, parts, strict=True)
            }
            if all(routes.values()):
                yield routes


def _draw(recipe: Recipe, rng: np.random.Generator) -> tuple[RoutingProblem, TrafficSnapshot]:
    land = LANDSCAPES[recipe.landscape](rng)
    depot = str(rng.choice(land.depots))
    sites = [site for site in land.sites if site != depot]
    number = count(1)
    service_s = float(rng.choice((30.0, 60.0, 90.0)))
    wanted = sum(recipe.first_stops) + recipe.pooled
    nodes = [str(site) for site in rng.choice(sites, wanted, replace=False)]
    stops = tuple(Stop(id=f"c{next(number)}", node=node, service_s=service_s) for node in nodes)
    own = iter(stops)
    vehicles = tuple(
        Vehicle(
            id=f"van-{letter}",
            first_stop=next(own).id if has_first else None,
            ready_s=round(float(rng.uniform(0.0, recipe.ready_within_s)), 1),
        )
        for letter, has_first in zip("abcdefgh", recipe.first_stops, strict=False)
    )
    fleet = Fleet(
        name=recipe.landscape,
        depots=(Depot(id=DEPOT, node=depot),),
        stops=stops,
        vehicles=vehicles,
    )
    snapshot = _traffic(recipe.stability, land.network, rng)
    problem = RoutingProblem(land.network, fleet, objective="paper")
    return (
        _with_meeting_after_stop(problem, snapshot, rng) if recipe.meet == "stops" else problem
    ), snapshot


def _with_meeting_after_stop(
    problem: RoutingProblem, snapshot: TrafficSnapshot, rng: np.random.Generator
) -> RoutingProblem:
    """The same, one vehicle getting ready later, so that the first two could meet after a stop.

    They enter the first open segment that two of their arcs share, drawn from the arcs that do not
    leave the depot both, as far apart as they would have left the depot.
    """
    arcs = candidate_arcs(problem, least_energy_legs(problem, snapshot))
    first, second = problem.fleet.vehicles[:2]
    gaps = []
    for a, b in product(arcs, arcs):
        if (a.vehicle, b.vehicle) != (first.id, second.id) or a.leg.start == b.leg.start == DEPOT:
            continue
        entries = b.entries_s()
        shared = [
            entry - entries[name]
            for name, entry in a.entries_s().items()
            if name in entries and snapshot.segments[name].open
        ]
        gaps += shared[:1]
    if not gaps:
        return problem
    late_s = float(gaps[int(rng.integers(len(gaps)))])
    # The entries hold the vehicles' own delays; half of what differs is to stay.
    late_s += 0.5 * (first.ready_s - second.ready_s)
    delay_s = {first.id: max(0.0, -late_s), second.id: max(0.0, late_s)}
    vehicles = tuple(
        v.model_copy(update={"ready_s": round(v.ready_s + delay_s.get(v.id, 0.0), 1)})
        for v in problem.fleet.vehicles
    )
    return replace(problem, fleet=problem.fleet.model_copy(update={"vehicles": vehicles}))


def _traffic(
    stability: Stability, network: RoadNetwork, rng: np.random.Generator
) -> TrafficSnapshot:
    segments = {}
    for name, segment in network.segments.items():
        flags = _FLAGS[stability]
        flag = flags[int(rng.integers(len(flags)))]
        speed = segment.speed_limit_mps * float(rng.uniform(0.85, 1.0) if flag == 1 else 1.0)
        if flag == 0:
            speed = segment.speed_limit_mps * float(rng.uniform(0.5, 0.8))
        segments[name] = _segment_traffic(name, round(speed, 2), flag)
    return TrafficSnapshot(INSTANCE_TIME_NS, MappingProxyType(segments), ())


def _segment_traffic(name: str, speed_mps: float, y_e: Literal[0, 1] | None) -> SegmentTraffic:
    if y_e is None:
        return SegmentTraffic(name, speed_mps)
    return SegmentTraffic(
        segment=name,
        speed_mps=speed_mps,
        y_e=y_e,
        open=y_e == 1,
        reason=None if y_e == 1 else "turbulent",
        age_s=0.0,
        measured_speed_mps=speed_mps,
        acceleration_variance_m2ps4=0.1 if y_e == 1 else 0.8,
    )

"""Routes on matrices, by the search that finds a city's base routes.

Without roads nobody shares a segment, so there is nothing to platoon on: the search is all.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from dispatcher_daemon.fleet import Vehicle
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads import Floats
from dispatcher_daemon.planning.routes import base_routes
from dispatcher_daemon.settings import SearchSettings
from slipstream.vehicle_types import RoutingProfile
from slipstream_lab.research.instances.matrices.instance import MatrixInstance
from slipstream_lab.research.instances.matrices.schema import Measure

_TYPICAL_KWH: Final = 0.4
"""What a median way costs in the search: penalties are those of a city's fleet."""
_FEWEST_STOPS: Final = 75
"""Fewer stops are searched for as many iterations as these: no cycle waits for the answer."""
_TOLERANCE_S: Final = 1e-6


@dataclass(frozen=True)
class MatrixPlan:
    """Routes of an instance with matrices. `routes`: stops in order by vehicle; none for one that
    stays.
    """

    routes: Mapping[str, tuple[str, ...]]
    unserved: tuple[str, ...]
    faults: tuple[str, ...]
    sums: Mapping[Measure, float]
    straight_m: float
    wall_s: float


class _MatrixWays:
    """Matrices as base routes take them."""

    def __init__(self, instance: MatrixInstance) -> None:
        cost = instance.measures[instance.minimise]
        positive = cost[(cost > 0) & np.isfinite(cost)]
        per_kwh = float(np.median(positive)) / _TYPICAL_KWH if positive.size else 1.0
        self.row = instance.row
        self.search_cost_kwh: Floats = cost / per_kwh
        # The search rounds times up to tenths: what is one must not become the next.
        self.duration_s: Floats = np.maximum(instance.measures["duration"] - _TOLERANCE_S, 0.0)

    @property
    def by_profile(self) -> Mapping[RoutingProfile, _MatrixWays]:
        return {RoutingProfile(): self}

    def of(self, _: Vehicle) -> _MatrixWays:
        return self

    def leg(self, start: str, end: str) -> None:
        raise NotImplementedError(f"matrices have no way from {start} to {end}")


def search_matrix_instance(
    instance: MatrixInstance, settings: SearchSettings, executor: Executor, seed: int
) -> MatrixPlan:
    """Search routes, and check them; same seed, same routes, unless time ends the search."""
    began = time.monotonic()
    longer = math.ceil(_FEWEST_STOPS / max(1, len(instance.fleet.stops)))
    each = settings.iterations_per_stop * longer
    settings = settings.model_copy(update={"iterations_per_stop": each})
    problem = RoutingProblem(instance.network, instance.fleet)
    stops = [stop.id for stop in instance.fleet.stops]
    found = base_routes(problem, _MatrixWays(instance), stops, settings, executor, seed)
    wall_s = time.monotonic() - began
    sums = {name: _sum(instance, found.stops, of) for name, of in instance.measures.items()}
    return MatrixPlan(
        found.stops,
        found.unassigned,
        tuple(_faults(instance, found.stops, found.unassigned)),
        sums,
        _sum(instance, found.stops, instance.straight_m),
        wall_s,
    )


def _sum(instance: MatrixInstance, routes: Mapping[str, tuple[str, ...]], of: Floats) -> float:
    fleet, row = instance.fleet, instance.row
    ways = [
        (depot, *stops, depot)
        for vehicle, stops in routes.items()
        if stops
        for depot in (fleet.depot_of(fleet.vehicle_by_id[vehicle]).id,)
    ]
    return math.fsum(float(of[row[a], row[b]]) for way in ways for a, b in pairwise(way))


def _faults(
    instance: MatrixInstance, routes: Mapping[str, tuple[str, ...]], unserved: tuple[str, ...]
) -> Iterator[str]:
    fleet, row = instance.fleet, instance.row
    listed = sorted([*(s for stops in routes.values() for s in stops), *unserved])
    if listed != sorted(fleet.stop_by_id):
        yield "not every stop is on one route"
    for vehicle in fleet.vehicles:
        stops = [fleet.stop_by_id[s] for s in routes.get(vehicle.id, ())]
        overload = fleet.overload(vehicle, stops)
        if overload is not None:
            yield f"{vehicle.id} carries {overload}"
        if any(not fleet.may_serve(vehicle, stop) for stop in stops):
            yield f"{vehicle.id} serves another carrier's stop"
        place = depot = fleet.depot_of(vehicle).id
        # It may leave later, to wait less; nothing is served sooner by that.
        time_s = vehicle.ready_s
        for stop in stops:
            way_s = float(instance.measures["duration"][row[place], row[stop.id]])
            if math.isinf(way_s):
                yield f"no way leads from {place} to {stop.id}"
            time_s += way_s
            time_s = max(time_s, stop.earliest_s)
            if stop.latest_s is not None and time_s > stop.latest_s + _TOLERANCE_S:
                yield f"{vehicle.id} is at {stop.id} at {time_s:g} s, after {stop.latest_s:g} s"
            time_s += stop.service_s
            place = stop.id
        way_s = float(instance.measures["duration"][row[place], row[depot]])
        if math.isinf(way_s):
            yield f"no way leads from {place} to {depot}"
        time_s += way_s
        late = vehicle.return_by_s is not None and time_s > vehicle.return_by_s + _TOLERANCE_S
        if stops and late:
            yield f"{vehicle.id} is back at {time_s:g} s"

"""Where a request's ways come from: its own matrices, or our roads between its coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dispatcher_daemon.planning.roads import given_matrices
from dispatcher_daemon.service.vroom.build import build_problem, check_size
from dispatcher_daemon.service.vroom.engine import RoadWays, RoutingEngine
from dispatcher_daemon.service.vroom.model import Matrices, VroomProblem
from dispatcher_daemon.service.vroom.schema import Coordinates, ProfileMatrices, Request
from slipstream.errors import InputError

_Place = tuple[str, Coordinates | None, int | None]
"""(key, coordinates, index)."""


def with_matrices(request: Request, source: str) -> VroomProblem:
    """The problem with the request's matrices.

    Raises:
        InputError: a profile has none, or a place has no index, or one beyond a matrix.
    """
    given = request.profile_matrices
    by_profile = {}
    for number, vehicle in enumerate(request.vehicles):
        own = given.get(vehicle.profile)
        if own is None or own.durations is None:
            key = f"matrices.{vehicle.profile}"
            problem = f"no durations for vehicles.{number}"
            mend = "give them for all profiles, or coordinates without matrices"
            raise InputError(source, problem, mend, key=key)
        if vehicle.profile not in by_profile:
            by_profile[vehicle.profile] = _arrays(own)
    size = min(len(of.durations) for of in by_profile.values())
    found: dict[int, Coordinates | None] = {}
    for key, coordinates, index in _places(request):
        if index is None:
            mend = "give the row of the matrices"
            raise InputError(source, "no index beside matrices", mend, key=f"{key}_index")
        if index >= size:
            mend = f"give a row of the matrices, 0 to {size - 1}"
            raise InputError(source, f"row {index} of {size}", mend, key=f"{key}_index")
        found.setdefault(index, coordinates)

    def row(_: Coordinates | None, index: int | None) -> int:
        assert index is not None  # checked above
        return index

    places = [found.get(number) for number in range(size)]
    return build_problem(request, places, row, by_profile, source)


def with_roads(
    request: Request, engine: RoutingEngine, source: str
) -> tuple[VroomProblem, dict[str, RoadWays]]:
    """(the problem with ways over our roads, these by profile).

    Raises:
        InputError: a place has no coordinates, there is no such profile, or there is more than
            fits into memory.
        RoutingError: a place is too far from any road.
    """
    places: dict[Coordinates, int] = {}
    for key, coordinates, _ in _places(request):
        if coordinates is None:
            mend = "give [longitude, latitude]"
            raise InputError(source, "no coordinates", mend, key=key)
        places.setdefault(coordinates, len(places))
    profiles = dict.fromkeys(vehicle.profile for vehicle in request.vehicles)
    check_size(len(places), len(profiles), source)
    ways = {profile: engine.ways(profile, list(places), source) for profile in profiles}

    def row(coordinates: Coordinates | None, _: int | None) -> int:
        assert coordinates is not None  # checked above
        return places[coordinates]

    matrices = {profile: of.matrices() for profile, of in ways.items()}
    return build_problem(request, list(places), row, matrices, source), ways


def _places(request: Request) -> Iterator[_Place]:
    for job in request.jobs:
        yield f"jobs.{job.id}.location", job.location, job.location_index
    for number, shipment in enumerate(request.shipments):
        for name, step in (("pickup", shipment.pickup), ("delivery", shipment.delivery)):
            key = f"shipments.{number}.{name}.location"
            yield key, step.location, step.location_index
    for vehicle in request.vehicles:
        for name, coordinates, index in (
            ("start", vehicle.start, vehicle.start_index),
            ("end", vehicle.end, vehicle.end_index),
        ):
            if coordinates is not None or index is not None:
                yield f"vehicles.{vehicle.id}.{name}", coordinates, index


def _arrays(given: ProfileMatrices) -> Matrices:
    durations, distances, costs = (
        None if values is None else np.where(np.isinf(values), -1, values).astype(np.int64)
        for values in given_matrices(given.durations, given.distances, given.costs)
    )
    assert durations is not None  # the caller has looked
    return Matrices(durations, distances, costs)

"""A request and its matrices as one problem, checked against each other."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.service.vroom.model import (
    COST_UNITS,
    FOREVER,
    NO_WAY,
    PER_SECOND,
    Ints,
    Kind,
    Matrices,
    Van,
    VroomPause,
    VroomProblem,
    VroomVisit,
    VroomWays,
    Windows,
)
from dispatcher_daemon.service.vroom.schema import (
    Coordinates,
    Request,
    Shipment,
    TaskStep,
    VroomJob,
    VroomVehicle,
    Window,
)
from slipstream.errors import InputError

_METRE_UNITS: Final = COST_UNITS // 1000
"""Internal cost of a metre at one a kilometre."""
_PER_HOUR: Final = 3600
"""Cost of an hour's travel where none is given: one a second."""
_MAX_CELLS: Final = 12_000_000
"""Of all profiles' matrices together: some hundred MB."""
_MAX_SKILL_SETS: Final = 100
"""Each is a load of its own in the search."""
_MAX_COST: Final = 2**55
"""Internal, of a way: sums of some hundred ways stay exact."""

Row = Callable[[Coordinates | None, int | None], int]
"""Row in the matrices of coordinates or a given index."""


def check_size(places: int, kinds: int, source: str) -> None:
    """Check that the matrices of some kinds of vehicles fit into memory.

    Raises:
        InputError: they do not.
    """
    if kinds * places**2 > _MAX_CELLS:
        problem = f"{places} places with {kinds} kinds of vehicles"
        raise InputError(source, f"too many: {problem}", "split the request")


def build_problem(
    request: Request,
    coordinates: Sequence[Coordinates | None],
    row: Row,
    by_profile: Mapping[str, Matrices],
    source: str,
) -> VroomProblem:
    """Join a request with matrices.

    Raises:
        InputError: amounts of different lengths, ids twice, costs that contradict each other, or
            more than fits into memory.
    """
    size = len(request.vehicles[0].capacity)
    tasks = tuple(_tasks(request, row, size, source))
    different = len({task.skills for task in tasks})
    if different > _MAX_SKILL_SETS:
        mend = f"give at most {_MAX_SKILL_SETS}"
        raise InputError(source, f"{different} different sets of skills", mend, key="jobs.skills")
    ways: dict[object, VroomWays] = {}
    vans = []
    for number, spec in enumerate(request.vehicles):
        key = f"vehicles.{number}"
        _check_length(source, f"{key}.capacity", spec.capacity, size)
        for pause in spec.breaks:
            _check_length(source, f"{key}.breaks.{pause.id}.max_load", pause.max_load, size)
        _check_unique(source, f"{key}.breaks", [pause.id for pause in spec.breaks])
        matrices = by_profile[spec.profile]
        _check_costs(spec, matrices, key, source)
        kind = spec.profile, _factor(spec), spec.costs
        if kind not in ways:
            check_size(len(coordinates), len(ways) + 1, source)
            ways[kind] = _ways(spec, matrices, source)
        begins, ends = (
            None if place is None and index is None else row(place, index)
            for place, index in ((spec.start, spec.start_index), (spec.end, spec.end_index))
        )
        window = (0, FOREVER) if spec.time_window is None else windows_of([spec.time_window])[0]
        pauses = [
            VroomPause(b, windows_of(b.time_windows), PER_SECOND * b.service) for b in spec.breaks
        ]
        pauses.sort(key=lambda pause: pause.windows[0])
        vans.append(
            Van(
                *(number, spec, ways[kind], begins, ends, window),
                tuple(pauses),
                frozenset(spec.skills),
            )
        )
    _check_unique(source, "vehicles", [van.spec.id for van in vans])
    return VroomProblem(request, tasks, tuple(vans), tuple(coordinates), by_profile)


def _tasks(request: Request, row: Row, size: int, source: str) -> Iterator[VroomVisit]:
    number = 0
    for job in request.jobs:
        key = f"jobs.{job.id}"
        former = job.delivery is None and job.pickup is None
        delivery = job.amount if former else job.delivery
        _check_length(source, f"{key}.delivery", delivery, size)
        _check_length(source, f"{key}.pickup", job.pickup, size)
        yield _task(number, "job", job, job, row, delivery, job.pickup, size)
        number += 1
    for index, shipment in enumerate(request.shipments):
        _check_length(source, f"shipments.{index}.amount", shipment.amount, size)
        amount, (first, last) = shipment.amount, (shipment.pickup, shipment.delivery)
        yield _task(number, "pickup", first, shipment, row, None, amount, size, number + 1)
        yield _task(number + 1, "delivery", last, shipment, row, amount, None, size, number)
        number += 2
    _check_unique(source, "jobs", [job.id for job in request.jobs])
    _check_unique(source, "shipments.pickup", [s.pickup.id for s in request.shipments])
    _check_unique(source, "shipments.delivery", [s.delivery.id for s in request.shipments])


def _task(
    number: int,
    kind: Kind,
    step: TaskStep,
    shared: VroomJob | Shipment,
    row: Row,
    delivery: tuple[int, ...] | None,
    pickup: tuple[int, ...] | None,
    size: int,
    partner: int | None = None,
) -> VroomVisit:
    return VroomVisit(
        *(number, kind, step, row(step.location, step.location_index)),
        windows_of(step.time_windows),
        delivery or (0,) * size,
        pickup or (0,) * size,
        frozenset(shared.skills),
        shared.priority,
        partner,
    )


def _check_length(source: str, key: str, amount: tuple[int, ...] | None, size: int) -> None:
    if amount is not None and len(amount) != size:
        problem = f"{len(amount)} components, the first vehicle's capacity has {size}"
        raise InputError(source, problem, "give as many", key=key)


def _check_unique(source: str, key: str, ids: Sequence[int]) -> None:
    twice = next((one for one, count in Counter(ids).items() if count > 1), None)
    if twice is not None:
        raise InputError(source, f"id {twice} is given twice", "rename one", key=key)


def _check_costs(spec: VroomVehicle, matrices: Matrices, key: str, source: str) -> None:
    needs_metres = spec.costs.per_km or spec.max_distance is not None
    if needs_metres and matrices.distances is None:
        name = "max_distance" if spec.max_distance is not None else "costs.per_km"
        mend = f"give matrices.{spec.profile}.distances"
        raise InputError(source, "distances are not known", mend, key=f"{key}.{name}")
    if matrices.costs is not None and (spec.costs.per_hour is not None or spec.costs.per_km):
        mend = "give prices or a matrix of costs, not both"
        raise InputError(source, "beside a matrix of costs", mend, key=f"{key}.costs")


def _factor(spec: VroomVehicle) -> int:
    """Hundredths of a second of one second in the matrix."""
    return max(1, math.floor(PER_SECOND / spec.speed_factor + 0.5))


def _ways(spec: VroomVehicle, matrices: Matrices, source: str) -> VroomWays:
    seconds, metres = matrices.durations, matrices.distances
    per_hour = _PER_HOUR if spec.costs.per_hour is None else spec.costs.per_hour
    dearest = max(
        _factor(spec) * int(seconds.max()) * per_hour,
        _METRE_UNITS * spec.costs.per_km * (0 if metres is None else int(metres.max())),
        COST_UNITS * (0 if matrices.costs is None else int(matrices.costs.max())),
    )
    if dearest > _MAX_COST:
        problem = f"the dearest way of vehicle {spec.id} costs {dearest // COST_UNITS}"
        raise InputError(source, problem, f"at most {_MAX_COST // COST_UNITS} is possible")
    duration = _factor(spec) * seconds
    if matrices.costs is not None:
        cost = COST_UNITS * matrices.costs
    else:
        cost = per_hour * duration
        if spec.costs.per_km and metres is not None:
            cost = cost + _METRE_UNITS * spec.costs.per_km * metres
    blocked = seconds < 0
    distance = None if metres is None else _rows(metres, blocked)
    return VroomWays(_rows(duration, blocked), distance, _rows(cost, blocked))


def _rows(values: Ints, blocked: npt.NDArray[np.bool_]) -> list[array[int]]:
    """Rows of whole numbers that Python reads quickly, at eight bytes each."""
    return [array("q", row.tobytes()) for row in np.where(blocked, NO_WAY, values)]


def windows_of(given: Iterable[Window] | None) -> Windows:
    """Windows in order; without any, always."""
    if given is None:
        return ((0, FOREVER),)
    return tuple(sorted((PER_SECOND * w.start, PER_SECOND * w.end) for w in given))

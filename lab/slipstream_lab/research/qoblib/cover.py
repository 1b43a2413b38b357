"""A capacitated routing problem as a choice of whole routes that serve each stop once.

All routes that can be part of an answer are listed: where k vehicles have room Q each, those with
a load from Σd − (k − 1)Q to Q, since the other vehicles could not take the rest otherwise. Each has
the least length over its stops, by the recursion over subsets of Bellman (1962) and of Held and
Karp (1962). So the choice (a set partitioning problem, Balinski and Quandt 1964) has the routing
problem's optimum, and nothing in the list tells which routes are good together. QOBLIB's instances
fill all vehicles to the last unit, which leaves few hundred routes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import dimod
import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms import QuboModel, build_model
from slipstream.errors import InputError
from slipstream_lab.research.instances.matrices import MatrixInstance
from slipstream_lab.research.models.qubo import MAX_VARIABLES, qubo_of

Bits = npt.NDArray[np.int8]
Floats = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_MAX_STOPS: Final = 22
"""All subsets of so many are listed."""
_MAX_ROUTE_STOPS: Final = 14


@dataclass(frozen=True)
class CoverModel:
    """Routes to choose from, as a QUBO and for the exact solver.

    Attributes:
        routes: stops in order, by number from 0 in the instance's order; x_r chooses route r.
        costs: of the routes, as the instance measures them, shape (routes,).
        rows: what a choice has to add up to, shape (rows, routes): each stop once; and, unless
            loads imply it, as many routes as there are vehicles.
        targets: what it adds up to, shape (rows,).
        penalty: weight of a row's squared miss in the QUBO: the dearest route's cost. That a wrong
            choice is never better is not proven with it; answers are checked by rows.
        bqm: Σ c x + penalty · Σ (row − target)², variables in the order of the routes.
        qubo: the same divided by a power of two, without its offset, as solvers take it.
    """

    instance: MatrixInstance
    routes: tuple[tuple[int, ...], ...]
    costs: Floats
    rows: Floats
    targets: Floats
    penalty: float
    bqm: Any
    qubo: QuboModel
    cpu_s: float

    def valid(self, bits: Bits) -> npt.NDArray[np.bool_]:
        """Which samples, shape (samples, routes), choose routes that serve each stop once."""
        found: npt.NDArray[np.bool_] = (bits @ self.rows.T == self.targets).all(axis=1)
        return found

    def chosen(self, bits: Bits) -> tuple[tuple[int, ...], ...]:
        """The routes of one sample, shape (routes,)."""
        return tuple(self.routes[r] for r in np.flatnonzero(bits))


def build_cover(instance: MatrixInstance, path: Path) -> CoverModel:
    """List the routes of an instance and write the choice as a QUBO.

    Raises:
        InputError: it has too many stops or routes, vehicles that are not needed or differ, or what
            such routes cannot express.
    """
    began = time.process_time()
    members, full = _members(instance, path)
    routes, costs = _shortest(instance, members)
    rows, targets = members.T.astype(float), np.ones(members.shape[1])
    if not full:
        rows = np.vstack([rows, np.ones(len(members))])
        targets = np.append(targets, len(instance.fleet.vehicles))
    penalty = float(costs.max(initial=0.0))
    bqm = _qubo(costs, rows, targets, penalty)
    qubo = build_model(qubo_of(bqm).problem)
    cpu_s = time.process_time() - began
    return CoverModel(instance, routes, costs, rows, targets, penalty, bqm, qubo, cpu_s)


def count_routes(instance: MatrixInstance, path: Path) -> int:
    """How many routes there are to choose from; raises as `build_cover` does."""
    return len(_members(instance, path)[0])


def _members(instance: MatrixInstance, path: Path) -> tuple[Index, bool]:
    """(stops of each possible route as rows of 0 and 1, whether each route fills a vehicle)."""
    demands, room, vehicles = _limits(instance, path)
    loads = np.zeros(1, dtype=np.int64)
    for demand in demands:
        loads = np.concatenate([loads, loads + demand])
    least = sum(demands) - (vehicles - 1) * room
    masks = np.flatnonzero((loads >= least) & (loads <= room))
    if not 1 <= len(masks) <= MAX_VARIABLES:
        problem = f"{len(masks)} routes to choose from; from 1 to {MAX_VARIABLES} are taken"
        raise InputError(path, problem, "give another instance")
    members = (masks[:, None] >> np.arange(len(demands))) & 1
    longest = int(members.sum(axis=1).max())
    if longest > _MAX_ROUTE_STOPS:
        problem = f"a route may have {longest} stops; the most is {_MAX_ROUTE_STOPS}"
        raise InputError(path, problem, "give an instance with smaller vehicles")
    return members, least == room


def _limits(instance: MatrixInstance, path: Path) -> tuple[list[int], int, int]:
    """(demands, room of each vehicle, vehicles)."""
    fleet = instance.fleet
    rooms = {vehicle.capacity for vehicle in fleet.vehicles}
    room = next(iter(rooms))
    windows = any(stop.latest_s is not None for stop in fleet.stops)
    if len(fleet.depots) > 1 or len(rooms) > 1 or not room or windows:
        problem = "not one depot and vehicles with one capacity, without time windows"
        raise InputError(path, problem, "give a CVRP")
    if not np.isfinite(instance.measures[instance.minimise]).all():
        raise InputError(path, "ways are missing", "give one whose matrix has all")
    demands = [stop.demand for stop in fleet.stops]
    if len(demands) > _MAX_STOPS:
        problem = f"{len(demands)} stops; the most is {_MAX_STOPS}"
        raise InputError(path, problem, "give a smaller instance")
    if -(-sum(demands) // room) != len(fleet.vehicles):
        problem = f"the demand {sum(demands)} does not need exactly {len(fleet.vehicles)} vehicles"
        raise InputError(path, problem, "give an instance that fills all its vehicles")
    return demands, room, len(fleet.vehicles)


def _shortest(
    instance: MatrixInstance, members: Index
) -> tuple[tuple[tuple[int, ...], ...], Floats]:
    """The shortest order of each set of stops, and its cost; sets as rows of 0 and 1."""
    at = instance.row
    order = [at[instance.fleet.depots[0].id], *(at[stop.id] for stop in instance.fleet.stops)]
    cost = instance.measures[instance.minimise][np.ix_(order, order)]
    routes: list[tuple[int, ...]] = [()] * len(members)
    costs = np.zeros(len(members))
    counts = members.sum(axis=1)
    for count in np.unique(counts):
        own = np.flatnonzero(counts == count)
        stops = np.nonzero(members[own])[1].reshape(len(own), count)
        orders, costs[own] = _tours(cost, stops + 1)
        for r, tour in zip(own.tolist(), orders.tolist(), strict=True):
            routes[r] = tuple(tour)
    return tuple(routes), costs


def _tours(cost: Floats, places: Index) -> tuple[Index, Floats]:
    """Shortest tours from place 0 over sets of m places, shapes (sets, m) and (sets,). `places`:
    shape (sets, m).
    """
    sets, m = places.shape
    between = cost[places[:, :, None], places[:, None, :]]
    out, back = cost[0, places], cost[places, 0]
    # By subset and last place: the least cost of reaching it, and the place before.
    least = np.full((1 << m, sets, m), np.inf)
    before = np.zeros((1 << m, sets, m), dtype=np.int8)
    for subset in range(1, 1 << m):
        for last in range(m):
            if not subset >> last & 1:
                continue
            rest = subset ^ (1 << last)
            if not rest:
                least[subset, :, last] = out[:, last]
                continue
            tried = least[rest] + between[:, :, last]
            before[subset, :, last] = tried.argmin(axis=1)
            least[subset, :, last] = tried.min(axis=1)
    whole = least[-1] + back
    number, last_of, subset_of = np.arange(sets), whole.argmin(axis=1), np.full(sets, (1 << m) - 1)
    costs, orders = whole[number, last_of], np.empty((sets, m), dtype=np.int64)
    for position in reversed(range(m)):
        orders[:, position] = places[number, last_of] - 1
        previous = before[subset_of, number, last_of].astype(np.int64)
        subset_of = subset_of ^ (1 << last_of)
        last_of = previous
    return orders, costs


def _qubo(costs: Floats, rows: Floats, targets: Floats, penalty: float) -> Any:
    """Σ c x + P Σ (a x − b)², with x² = x."""
    shared = rows.T @ rows
    linear = costs + penalty * (np.diagonal(shared) - 2 * targets @ rows)
    first, second = np.nonzero(np.triu(shared, 1))
    bqm: Any = dimod.BinaryQuadraticModel("BINARY")
    # In this order, which samples keep.
    bqm.add_linear_from(enumerate(linear.tolist()))
    biases = (2 * penalty * shared[first, second]).tolist()
    bqm.add_quadratic_from(zip(first.tolist(), second.tolist(), biases, strict=True))
    bqm.offset = penalty * float(targets @ targets)
    return bqm


def check_answer(
    instance: MatrixInstance, routes: Sequence[Sequence[int]]
) -> tuple[float, str | None]:
    """(cost, the rule that is broken or None) of routes by numbers of stops, without the model."""
    fleet = instance.fleet
    stops = [[fleet.stops[number] for number in route] for route in routes]
    if sorted(number for route in routes for number in route) != list(range(len(fleet.stops))):
        return 0.0, "not every stop is served once"
    if len([route for route in routes if route]) > len(fleet.vehicles):
        return 0.0, "more routes than vehicles"
    vehicle = fleet.vehicles[0]
    if any(fleet.overload(vehicle, route) is not None for route in stops):
        return 0.0, "a vehicle is too full"
    cost, row, depot = instance.measures[instance.minimise], instance.row, fleet.depots[0].id
    total = 0.0
    for route in stops:
        places = [row[name] for name in (depot, *(stop.id for stop in route), depot)]
        total += float(cost[places[:-1], places[1:]].sum())
    return total, None

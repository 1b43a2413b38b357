"""Tours that have not begun: an order that comes between cycles may be put into one of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from dispatcher_daemon.fleet.models import Fleet
from dispatcher_daemon.fleet.stops import Depot, Stop
from dispatcher_daemon.fleet.tracking.availability import Availability
from dispatcher_daemon.fleet.tracking.order_stops import stop_of
from dispatcher_daemon.fleet.tracking.orders import OrderBook
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle
from dispatcher_daemon.fleet.vehicles import Vehicle
from slipstream.messages import VehiclePlan


@dataclass(frozen=True)
class OpenTour:
    """What a vehicle that has not left would do.

    Attributes:
        vehicle: leaves no sooner than by its present plan.
        stops: that it has, in the order of its plan; none: it stays idle.
    """

    vehicle: Vehicle
    depot: Depot
    stops: tuple[Stop, ...] = ()


def open_tours(
    fleet: Fleet | None,
    vehicles: Iterable[TrackedVehicle],
    available: Availability,
    book: OrderBook,
    cycle: int,
    now_ns: int,
    reference_ns: int,
) -> Iterator[OpenTour]:
    """Tours of vehicles that could be told of another stop before they leave.

    Left out are plans with platoons, as partners count on them, and with hubs or charging stops;
    and vehicles with a time to be back, once they have a plan, as that time counts from a cycle
    of before.
    """
    for tracked in vehicles:
        if not tracked.listed or available.obstacle(tracked, cycle, now_ns) is not None:
            continue
        record = tracked.accepted or tracked.offered
        vehicle = tracked.plannable(reference_ns)
        if record is None:
            loaded = vehicle.first_stop
            if loaded is None or _has_ended(book, loaded):
                idle = vehicle.model_copy(update={"first_stop": None})
                yield OpenTour(idle, tracked.depot)
            continue
        plan = record.plan
        if tracked.left or not _may_grow(plan, reference_ns) or vehicle.return_by_s is not None:
            continue
        held = set(book.held_by(tracked.id))
        orders = [book.orders[stop.stop] for stop in plan.service_stops if stop.stop in held]
        stops = tuple(stop_of(order, fleet, reference_ns) for order in orders)
        first = vehicle.first_stop if stops and stops[0].id == vehicle.first_stop else None
        times = {"ready_s": 1e-9 * (plan.depart_ns - reference_ns), "depart_by_s": None}
        yield OpenTour(
            vehicle.model_copy(update={**times, "first_stop": first}), tracked.depot, stops
        )


def _may_grow(plan: VehiclePlan, reference_ns: int) -> bool:
    return (
        plan.depart_ns >= reference_ns
        and len(plan.service_stops) == len(plan.stops) - 2
        and all(segment.platoon is None for segment in plan.segments)
    )


def _has_ended(book: OrderBook, name: str) -> bool:
    order = book.orders.get(name)
    return order is None or order.ended


def fleet_of(fleet: Fleet, tours: Sequence[OpenTour], stops: Iterable[Stop]) -> Fleet:
    """The fleet of tours, with their stops and others."""
    depots = dict(fleet.depot_by_id)
    vehicles = []
    for tour in tours:
        depot = tour.depot
        if depots.get(depot.id, depot) != depot:
            continue  # The file has moved it: the next cycle plans from there.
        depots[depot.id] = depot
        vehicles.append(tour.vehicle.model_copy(update={"depot": depot.id}))
    kept = {vehicle.id for vehicle in vehicles}
    held = [stop for tour in tours if tour.vehicle.id in kept for stop in tour.stops]
    parts = {"depots": tuple(depots.values()), "vehicles": tuple(vehicles)}
    return Fleet.model_construct(**fleet.parts | parts | {"stops": (*held, *stops)})

"""Where a cycle begins: free vehicles, orders that may be planned, vehicles bound to plans."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from dispatcher_daemon.fleet.commitments import Commitment
from dispatcher_daemon.fleet.models import Fleet
from dispatcher_daemon.fleet.road_users import RoadUser
from dispatcher_daemon.fleet.stops import Stop
from dispatcher_daemon.fleet.tracking.order_stops import stops_at
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle
from dispatcher_daemon.fleet.vehicles import Vehicle
from slipstream.orders import OrderRecord

HIDDEN: Final = "a caller's order that has not ended has its id"
"""Reason of the file's stops that are not planned for this."""
IDLE: Final = "; idle: "
"""In a reason, before what keeps each vehicle that has no work."""
_MAX_NAMED: Final = 5
"""Vehicles that are named of those with the same obstacle, and obstacles of an order."""


@dataclass(frozen=True)
class FleetSituation:
    """The fleet of one cycle.

    Attributes:
        fleet: free vehicles and open orders, the file's before those of callers, then the vehicles
            with commitments and their stops. The fleet's file itself where no vehicle has ever
            reported and nobody has submitted an order. None: nothing to plan.
        left_out: reason by vehicle that is not planned in this cycle; it keeps what it has.
        hidden: stops of the file that are not planned, as a caller's order that has not ended has
            their id.
        on_road: of these, those on their way to charge or to a hub: others may meet them.
        waiting: reason by order that is due and that the fleet does not have: nothing can be
            planned of it in this cycle.
        later: likewise by order that is not due yet.
        idle: reason by vehicle that is left out and has no plan either.
        nobody: why no vehicle is there for an order.
    """

    fleet: Fleet | None
    commitments: tuple[Commitment, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    on_road: tuple[RoadUser, ...] = ()
    hidden: tuple[str, ...] = ()
    waiting: Mapping[str, str] = field(default_factory=dict)
    later: Mapping[str, str] = field(default_factory=dict)
    idle: Mapping[str, str] = field(default_factory=dict)
    nobody: str = "no vehicle is free"


def idle_text(found: Mapping[str, str]) -> str:
    """What keeps each vehicle without work, to be put behind a reason; those alike together."""
    alike: dict[str, list[str]] = {}
    for vehicle, why in found.items():
        alike.setdefault(why, []).append(vehicle)
    kinds = sorted(alike.items(), key=lambda one: -len(one[1]))
    texts: list[str] = []
    for why, names in kinds[:_MAX_NAMED]:
        more = f" and {len(names) - _MAX_NAMED} more" if len(names) > _MAX_NAMED else ""
        texts.append(f"{', '.join(names[:_MAX_NAMED])}{more}: {why}")
    if rest := sum(len(names) for _, names in kinds[_MAX_NAMED:]):
        texts.append(f"{rest} more: other reasons")
    return f"{IDLE}{'; '.join(texts)}" if texts else ""


def nobody_free(fleet: Fleet | None, left_out: Mapping[str, str], bound: int) -> str:
    """Why no vehicle is there for an order, with how many there are of each kind."""
    counts = Counter(left_out.values())
    kinds = [f"{count} {what}" for what, count in counts.most_common()]
    kinds += [f"{bound} on the way"] if bound else []
    if not kinds and fleet is None:
        return "no vehicle is in the fleet's file"
    return f"{FleetSituation.nobody}{': ' if kinds else ''}{', '.join(kinds)}"


def cycle_fleet(
    fleet: Fleet | None,
    free: Sequence[Vehicle],
    bound: Sequence[Commitment],
    vehicles: Mapping[str, TrackedVehicle],
    orders: Mapping[str, OrderRecord],
    may_plan: Callable[[str], bool],
    reference_ns: int,
    requested: Sequence[Stop] = (),
) -> Fleet | None:
    """The fleet of a cycle; see `FleetSituation`.

    Args:
        free: vehicles of it that may be planned from their depots.
    """
    stops = () if fleet is None else tuple(_of_file(fleet.stops, orders))
    listed = () if fleet is None else fleet.vehicles
    ready = {vehicle.id for vehicle in free}
    # What is loaded on a vehicle that cannot be planned now is not for others.
    aboard = {vehicle.first_stop for vehicle in listed if vehicle.id not in ready}
    pool = [stop for stop in stops if may_plan(stop.id) and stop.id not in aboard]
    pool += requested
    whole = fleet is not None and fleet.stops and tuple(pool) == fleet.stops
    if not bound and whole and {*free} == {*listed}:
        return fleet
    if not bound and not (free and pool):
        return None
    # A caller's order of that id is another one, and a pin may give a stop to another vehicle.
    own_first = {stop.id: stop for stop in pool if orders[stop.id].request is None}
    planned = [
        vehicle
        if vehicle.first_stop is None
        or (
            fleet is not None
            and vehicle.first_stop in own_first
            and fleet.may_serve(vehicle, own_first[vehicle.first_stop])
        )
        else vehicle.model_copy(update={"first_stop": None})
        for vehicle in free
    ]
    depots = {} if fleet is None else dict(fleet.depot_by_id)
    for own in bound:
        vehicle = vehicles[own.vehicle]
        pool += stops_at([orders[order] for order in own.stops], reference_ns)
        depot = vehicle.depot
        if depots.get(depot.id, depot) != depot:
            # The file has moved its depot since it left.
            depot = depot.model_copy(update={"id": f"{depot.id} of {own.vehicle}"})
        depots[depot.id] = depot
        place = {"depot": depot.id, "first_stop": own.stops[0] if own.stops else None}
        planned.append(vehicle.charged().model_copy(update=place))
    # Its parts have been checked, and a fleet on its way home has no stop.
    return Fleet.model_construct(
        name="fleet" if fleet is None else fleet.name,
        depots=tuple(depots.values()),
        stops=tuple(pool),
        vehicles=tuple(planned),
        vehicle_types=() if fleet is None else fleet.vehicle_types,
        charging_stops=() if fleet is None else fleet.charging_stops,
        hubs=() if fleet is None else fleet.hubs,
    )


def _of_file(stops: Iterable[Stop], orders: Mapping[str, OrderRecord]) -> Iterator[Stop]:
    """The file's stops, but for those whose id a caller's order has; pinned ones for their vehicle
    only.
    """
    for stop in stops:
        order = orders[stop.id]
        if order.request is None:
            pinned = order.pinned or stop.vehicle
            yield stop if pinned == stop.vehicle else stop.model_copy(update={"vehicle": pinned})

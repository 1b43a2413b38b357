"""The fleet: depots, stops and vehicles, read from a file and checked against the road network."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from slipstream.config import Settings, check, read_data
from slipstream.errors import InputError
from slipstream.messages import Identifier
from slipstream.roads import RoadNetwork
from slipstream.snapping import Snapper
from slipstream.vehicle_types import PRESETS, RoutingProfile, VehicleType

log = logging.getLogger(__name__)

DEMO_FLEET = "demo"

DEPOT: Final = "depot"
"""In the arc form this place stands for each vehicle's own depot; no stop may have its name."""

_DAY_S: Final = 86400.0
_TOLERANCE_KG: Final = 1e-6
_PLACES: Final = ("depots", "stops", "charging_stops")
_UNKNOWN_NODE: Final = "by latitude and longitude"

MAX_SNAP_M: Final = 200.0
"""From a place by latitude and longitude to the nearest road; one further away is refused."""

_PowerKw = Annotated[float, Field(gt=0, le=1e5, allow_inf_nan=False)]


class _Point(Settings):
    """Where a place is, as a fleet's file may give it instead of a junction."""

    lat: float | None = Field(
        default=None, ge=-90, le=90, allow_inf_nan=False, description="Latitude, degrees (WGS 84)."
    )
    lon: float | None = Field(
        default=None, ge=-180, le=180, allow_inf_nan=False, description="Longitude, degrees."
    )

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.lat is None) != (self.lon is None):
            raise ValueError("give lat and lon, or neither")
        return self


class Depot(_Point):
    """Where vehicles start and end."""

    id: Identifier = DEPOT
    node: Identifier = Field(description="Junction of the road network; or `lat` and `lon`.")
    charging_power_kw: _PowerKw | None = Field(
        default=None, description="Vehicles charge while they wait there; None: they cannot."
    )


class ChargingStop(_Point):
    """Where vehicles may charge on their way."""

    id: Identifier
    node: Identifier = Field(description="Junction of the road network; or `lat` and `lon`.")
    power_kw: _PowerKw


class NamedVehicleType(VehicleType):
    """A vehicle type of a fleet, for its vehicles to name."""

    id: Identifier


class Stop(_Point):
    """One delivery. Stops may share a junction with each other and with a depot.

    All times count from the reference time of the cycle: when a vehicle that is ready at once
    leaves.
    """

    id: Identifier
    node: Identifier = Field(description="Junction of the road network; or `lat` and `lon`.")
    service_s: float = Field(default=60.0, ge=0, le=_DAY_S, allow_inf_nan=False)
    demand: int = Field(
        default=0, ge=0, le=10**9, description="What it takes of a vehicle's capacity."
    )
    mass_kg: float = Field(
        default=0.0,
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="What it takes of a vehicle's payload.",
    )
    earliest_s: float = Field(
        default=0.0, ge=0, le=_DAY_S, allow_inf_nan=False, description="Service starts no sooner."
    )
    latest_s: float | None = Field(
        default=None,
        ge=0,
        le=_DAY_S,
        allow_inf_nan=False,
        description="Service starts no later; None: whenever.",
    )

    @model_validator(mode="after")
    def _window_is_open(self) -> Self:
        if self.latest_s is not None and self.latest_s < self.earliest_s:
            raise ValueError(
                f"latest_s ({self.latest_s:g}) must not be below earliest_s ({self.earliest_s:g})"
            )
        return self


_Place = Depot | Stop | ChargingStop


class Vehicle(Settings):
    """One vehicle.

    A vehicle with a first stop has that parcel loaded and drives there first. Stops that are
    nobody's first stop are pooled: any vehicle may serve them. It leaves its depot within
    [``ready_s``, ``depart_by_s``], s after the reference time of the cycle.
    """

    id: Identifier
    depot: Identifier | None = Field(
        default=None, description="Where it starts and ends; None: the first depot."
    )
    first_stop: Identifier | None = None
    capacity: int | None = Field(
        default=None, ge=0, le=10**9, description="Total demand it can carry; None: any."
    )
    ready_s: float = Field(
        default=0.0, ge=0, le=_DAY_S, allow_inf_nan=False, description="Leaves no sooner."
    )
    depart_by_s: float | None = Field(
        default=None,
        ge=0,
        le=_DAY_S,
        allow_inf_nan=False,
        description="Leaves no later; None: leaves when it is ready.",
    )
    return_by_s: float | None = Field(
        default=None,
        ge=0,
        le=2 * _DAY_S,
        allow_inf_nan=False,
        description="Is back at its depot by then; None: whenever.",
    )
    type: Identifier | None = Field(
        default=None,
        description="A preset or one of `vehicle_types`; None: the paper's car.",
    )
    own_type: VehicleType | None = Field(
        default=None, description="Data of this vehicle alone, instead of `type`."
    )
    charge_kwh: float | None = Field(
        default=None,
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="In its battery when the fleet's times begin; None: it is full.",
    )

    @model_validator(mode="after")
    def _one_type(self) -> Self:
        if self.type is not None and self.own_type is not None:
            raise ValueError("give type or own_type, not both")
        return self

    @model_validator(mode="after")
    def _times_are_in_order(self) -> Self:
        for name in ("depart_by_s", "return_by_s"):
            value: float | None = getattr(self, name)
            if value is not None and value < self.ready_s:
                raise ValueError(f"{name} ({value:g}) must not be below ready_s ({self.ready_s:g})")
        return self


class Fleet(Settings):
    """Depots, stops and vehicles of one dispatch."""

    name: str = "fleet"
    depots: tuple[Depot, ...] = Field(min_length=1)
    stops: tuple[Stop, ...] = Field(min_length=1)
    vehicles: tuple[Vehicle, ...] = Field(min_length=1)
    vehicle_types: tuple[NamedVehicleType, ...] = ()
    charging_stops: tuple[ChargingStop, ...] = ()

    @cached_property
    def stop_by_id(self) -> dict[str, Stop]:
        """Stops by their id."""
        return {stop.id: stop for stop in self.stops}

    @cached_property
    def depot_by_id(self) -> dict[str, Depot]:
        """Depots by their id."""
        return {depot.id: depot for depot in self.depots}

    @cached_property
    def charging_stop_by_id(self) -> dict[str, ChargingStop]:
        """Charging stops by their id."""
        return {stop.id: stop for stop in self.charging_stops}

    @cached_property
    def vehicle_by_id(self) -> dict[str, Vehicle]:
        """Vehicles by their id."""
        return {vehicle.id: vehicle for vehicle in self.vehicles}

    @cached_property
    def _types(self) -> dict[str, VehicleType]:
        return {**PRESETS, **{kind.id: kind for kind in self.vehicle_types}}

    @cached_property
    def pooled(self) -> tuple[str, ...]:
        """Ids of the stops that any vehicle may serve."""
        taken = {vehicle.first_stop for vehicle in self.vehicles}
        return tuple(stop.id for stop in self.stops if stop.id not in taken)

    def depot_of(self, vehicle: Vehicle) -> Depot:
        """Where a vehicle starts and ends."""
        return self.depots[0] if vehicle.depot is None else self.depot_by_id[vehicle.depot]

    def type_of(self, vehicle: Vehicle) -> VehicleType | None:
        """A vehicle's data; None: none are given."""
        if vehicle.own_type is not None:
            return vehicle.own_type
        # A vehicle under way may have a type that the file has no more.
        return None if vehicle.type is None else self._types.get(vehicle.type)

    def overload(self, vehicle: Vehicle, stops: Iterable[Stop]) -> str | None:
        """By what the load of some stops is more than a vehicle carries; None: it is not."""
        served = list(stops)
        demand = sum(stop.demand for stop in served)
        if vehicle.capacity is not None and demand > vehicle.capacity:
            return f"{demand}, more than its capacity of {vehicle.capacity}"
        kind = self.type_of(vehicle)
        payload_kg = None if kind is None else kind.payload_kg
        mass_kg = math.fsum(stop.mass_kg for stop in served)
        if payload_kg is not None and mass_kg > payload_kg + _TOLERANCE_KG:
            return f"{mass_kg:g} kg, more than its payload of {payload_kg:g} kg"
        return None

    def node(self, place: str) -> str:
        """Junction of a stop, a depot or a charging stop."""
        places: tuple[Mapping[str, _Place], ...] = (self.depot_by_id, self.charging_stop_by_id)
        for known in places:
            if place in known:
                return known[place].node
        return self.stop_by_id[place].node

    def service_s(self, place: str) -> float:
        """Time that service takes at a stop; none elsewhere."""
        return self.stop_by_id[place].service_s if place in self.stop_by_id else 0.0

    def legs(self, vehicle: Vehicle) -> tuple[tuple[str, str], ...]:
        """Candidate arcs (from, to) of one vehicle over its depot and stops.

        With f pooled stops these are f² + f + 2 for a vehicle that has a first stop and f² + f for
        one that has none.
        """
        depot, pooled = self.depot_of(vehicle).id, self.pooled
        between = [(i, j) for i in pooled for j in pooled if i != j]
        back = [(i, depot) for i in pooled]
        if vehicle.first_stop is None:
            return tuple([(depot, j) for j in pooled] + between + back)
        first = vehicle.first_stop
        out = [(depot, first), (first, depot)]
        return tuple(out + [(first, j) for j in pooled] + between + back)


def arc_form_obstacle(fleet: Fleet) -> str | None:
    """Why the arc form (the paper's) cannot express a fleet; None if it can.

    In it every vehicle drives, stops have no times, no load or charge is counted, and all vehicles
    share one set of paths. A capacity that no set of stops can exceed is no obstacle, nor is a
    departure window: vehicles then leave when they are ready.
    """
    kinds = {vehicle.id: fleet.type_of(vehicle) for vehicle in fleet.vehicles}
    if len({RoutingProfile() if kind is None else kind.profile for kind in kinds.values()}) > 1:
        return "its vehicles are of different types"
    for name, kind in kinds.items():
        if kind is not None and kind.battery_kwh is not None:
            return f"vehicle {name!r} has a battery"
    for stop in fleet.stops:
        if stop.earliest_s > 0 or stop.latest_s is not None:
            return f"stop {stop.id!r} has a time window"
    demand = {stop.id: stop.demand for stop in fleet.stops}
    pooled = sum(demand[name] for name in fleet.pooled)
    for vehicle in fleet.vehicles:
        if vehicle.return_by_s is not None:
            return f"vehicle {vehicle.id!r} has to be back in time"
        if fleet.overload(vehicle.model_copy(update={"capacity": None}), fleet.stops) is not None:
            return f"vehicle {vehicle.id!r} cannot carry the mass of all stops"
        most = pooled + (0 if vehicle.first_stop is None else demand[vehicle.first_stop])
        if vehicle.capacity is not None and most > vehicle.capacity:
            return (
                f"vehicle {vehicle.id!r} has a capacity of {vehicle.capacity} "
                f"and could be given a demand of {most}"
            )
    free = sum(vehicle.first_stop is None for vehicle in fleet.vehicles)
    if free > len(fleet.pooled):
        return (
            f"every vehicle has to drive, and {free} without a first stop are too many "
            f"for {len(fleet.pooled)} pooled stops"
        )
    return None


def load_fleet(reference: str | Path, network: RoadNetwork) -> Fleet:
    """Read a fleet.

    Args:
        reference: path of a TOML or JSON file, or ``"demo"`` for the fleet that is built in.
        network: the roads that its nodes lie on.

    Raises:
        InputError: the file is missing or malformed, or does not fit the network (see
            `check_fleet`).
    """
    if str(reference) == DEMO_FLEET:
        packed = resources.files("dispatcher_daemon") / "data" / "demo_fleet.toml"
        with resources.as_file(packed) as path:
            return fleet_from(read_data(path), network, DEMO_FLEET)
    return fleet_from(read_data(Path(reference)), network, reference)


def fleet_from(data: object, network: RoadNetwork, source: str | Path) -> Fleet:
    """Check plain data as a fleet; errors as in `load_fleet`.

    A place with latitude and longitude gets a node: the nearer end of the nearest road that some
    vehicle of the fleet may use, no more than `MAX_SNAP_M` away.
    """
    fleet = _located(check(_with_unknown_nodes(data), Fleet, source), network, source)
    check_fleet(fleet, network, source)
    return fleet


def _with_unknown_nodes(data: object) -> object:
    """Plain data in which a place with latitude and longitude alone has a node to be found."""
    if not isinstance(data, Mapping):
        return data

    def placed(rows: object) -> object:
        if not isinstance(rows, list | tuple):
            return rows
        return [
            {"node": _UNKNOWN_NODE, **row}
            if isinstance(row, Mapping) and ("lat" in row or "lon" in row)
            else row
            for row in rows
        ]

    return {key: placed(rows) if key in _PLACES else rows for key, rows in data.items()}


def _located(fleet: Fleet, network: RoadNetwork, source: str | Path) -> Fleet:
    """The fleet with the nodes of its places that are given by latitude and longitude."""
    places: list[tuple[str, _Place]] = [
        *(("depots", depot) for depot in fleet.depots),
        *(("stops", stop) for stop in fleet.stops),
        *(("charging_stops", stop) for stop in fleet.charging_stops),
    ]
    if all(place.node != _UNKNOWN_NODE for _, place in places):
        return fleet
    kinds = [fleet.type_of(vehicle) for vehicle in fleet.vehicles]
    snapper = Snapper(network, {RoutingProfile() if k is None else k.profile for k in kinds})
    found: dict[str, list[_Place]] = {table: [] for table in _PLACES}
    for table, place in places:
        if place.node == _UNKNOWN_NODE:
            node = _nearest_node(place, network, snapper, source, f"{table}.{place.id}")
            place = place.model_copy(update={"node": node})
        found[table].append(place)
    parts = {name: getattr(fleet, name) for name in Fleet.model_fields}
    return Fleet(**parts | {table: tuple(rows) for table, rows in found.items()})


def _nearest_node(
    place: _Place, network: RoadNetwork, snapper: Snapper, source: str | Path, key: str
) -> str:
    if network.projection is None or place.lat is None or place.lon is None:
        problem = f"network {network.name!r} knows no latitude and longitude"
        raise InputError(source, problem, "name a junction as node", key=f"{key}.lat")
    try:
        snapped = snapper.nearest(network.projection.place_m(place.lat, place.lon))
    except ValueError as error:
        mend = "name a junction as node"
        raise InputError(source, str(error), mend, key=f"{key}.lat") from None
    if snapped is None:
        problem = "no road that a vehicle of the fleet may use"
        raise InputError(source, problem, "check the vehicles' types", key=f"{key}.lat")
    if snapped.distance_m > MAX_SNAP_M:
        problem = f"{snapped.distance_m:.0f} m from the nearest road that its vehicles may use"
        mend = f"give a place within {MAX_SNAP_M:.0f} m of one"
        raise InputError(source, problem, mend, key=f"{key}.lat")
    log.info(
        "%s: %s lies %.0f m from %s and is served at its end %s",
        source,
        key,
        snapped.distance_m,
        snapped.segment,
        snapped.node,
    )
    return snapped.node


def check_fleet(fleet: Fleet, network: RoadNetwork, source: str | Path, prefix: str = "") -> None:
    """Check what a fleet refers to. Stops that cannot be served are no fault of the file's:
    `dispatcher_daemon.planning.servability.unservable` names them.

    Args:
        source: what errors name.
        prefix: put before the keys in errors, where the fleet is part of a larger file.

    Raises:
        InputError: a duplicate id, an unknown node, depot or vehicle type, a charge that does not
            fit the battery, or a first stop that does not exist or is claimed twice.
    """
    _no_duplicates(source, f"{prefix}depots", "id", (d.id for d in fleet.depots))
    _no_duplicates(source, f"{prefix}stops", "id", (s.id for s in fleet.stops))
    _no_duplicates(source, f"{prefix}vehicles", "id", (v.id for v in fleet.vehicles))
    _no_duplicates(source, f"{prefix}vehicle_types", "id", (t.id for t in fleet.vehicle_types))
    _no_duplicates(source, f"{prefix}charging_stops", "id", (c.id for c in fleet.charging_stops))
    for name in (DEPOT, *fleet.depot_by_id):
        if name in fleet.stop_by_id:
            raise InputError(
                source, "a stop has a depot's id", "rename it", key=f"{prefix}stops.{name}"
            )
    for name in fleet.charging_stop_by_id:
        if name == DEPOT or name in fleet.stop_by_id or name in fleet.depot_by_id:
            problem = "a charging stop has the id of a stop or depot"
            raise InputError(source, problem, "rename it", key=f"{prefix}charging_stops.{name}")
    for kind in fleet.vehicle_types:
        if kind.id in PRESETS:
            key = f"{prefix}vehicle_types.{kind.id}"
            raise InputError(source, "a vehicle type has a preset's id", "rename it", key=key)
    for place, node in (
        *((f"depots.{d.id}", d.node) for d in fleet.depots),
        *((f"stops.{s.id}", s.node) for s in fleet.stops),
        *((f"charging_stops.{c.id}", c.node) for c in fleet.charging_stops),
    ):
        if node not in network.junctions:
            raise InputError(
                source,
                f"unknown node {node!r}",
                f"use a junction of network {network.name!r}",
                key=f"{prefix}{place}.node",
            )
    for vehicle in fleet.vehicles:
        key = f"{prefix}vehicles.{vehicle.id}"
        if vehicle.depot is not None and vehicle.depot not in fleet.depot_by_id:
            raise InputError(
                source, f"no depot {vehicle.depot!r}", "name one of the depots", key=f"{key}.depot"
            )
        if vehicle.first_stop is not None and vehicle.first_stop not in fleet.stop_by_id:
            raise InputError(
                source,
                f"no stop {vehicle.first_stop!r}",
                "name one of the stops",
                key=f"{key}.first_stop",
            )
        _check_type(fleet, vehicle, source, key)
    first = [v.first_stop for v in fleet.vehicles if v.first_stop is not None]
    mend = "give each vehicle a stop of its own"
    _no_duplicates(source, f"{prefix}vehicles", "first_stop", first, mend)


def _check_type(fleet: Fleet, vehicle: Vehicle, source: str | Path, key: str) -> None:
    known = [*PRESETS, *(kind.id for kind in fleet.vehicle_types)]
    if vehicle.type is not None and vehicle.type not in known:
        mend = f"use one of {', '.join(known)}"
        raise InputError(source, f"no vehicle type {vehicle.type!r}", mend, key=f"{key}.type")
    kind = fleet.type_of(vehicle)
    capacity_kwh = None if kind is None else kind.battery_kwh
    if vehicle.charge_kwh is None:
        return
    if capacity_kwh is None:
        problem, mend = "a charge without a battery", "give its type a battery_kwh"
        raise InputError(source, problem, mend, key=f"{key}.charge_kwh")
    if vehicle.charge_kwh > capacity_kwh:
        problem = f"{vehicle.charge_kwh:g} kWh in a battery of {capacity_kwh:g} kWh"
        raise InputError(source, problem, "give what is in it", key=f"{key}.charge_kwh")


def _no_duplicates(
    source: str | Path, table: str, key: str, values: Iterable[str], mend: str = "rename one"
) -> None:
    for value, count in Counter(values).items():
        if count > 1:
            what = table.rpartition(".")[2]
            raise InputError(source, f"{count} {what} with {key} {value!r}", mend, key=table)

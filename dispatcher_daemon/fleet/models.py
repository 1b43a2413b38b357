"""The vehicles and places of one dispatch."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any, Final
from zoneinfo import ZoneInfo

from pydantic import Field

from dispatcher_daemon.fleet.clock import ZoneName
from dispatcher_daemon.fleet.stops import ChargingStop, Depot, Hub, Place, Stop
from dispatcher_daemon.fleet.vehicles import Break, NamedVehicleType, Vehicle
from slipstream.config import Settings
from slipstream.vehicle_types import PRESETS, VehicleType

_TOLERANCE_KG: Final = 1e-6


class Fleet(Settings):
    """Depots, stops and vehicles of one dispatch."""

    name: str = Field(default="fleet", description="For people.")
    time_zone: ZoneName = Field(
        default="UTC", description="Of clock times without one, such as Europe/Berlin."
    )
    depots: tuple[Depot, ...] = Field(min_length=1)
    stops: tuple[Stop, ...] = ()
    vehicles: tuple[Vehicle, ...] = Field(min_length=1)
    vehicle_types: tuple[NamedVehicleType, ...] = ()
    charging_stops: tuple[ChargingStop, ...] = ()
    hubs: tuple[Hub, ...] = ()

    @property
    def parts(self) -> dict[str, Any]:
        """What it was made of, to make another one: a copy would keep what this one has cached."""
        return {name: getattr(self, name) for name in Fleet.model_fields}

    @cached_property
    def has_clock_times(self) -> bool:
        """Whether some times of it are no seconds."""
        breaks = (own for vehicle in self.vehicles for own in vehicle.breaks)
        rows: tuple[Stop | Vehicle | Break, ...] = (*self.stops, *self.vehicles, *breaks)
        return any(text is not None for row in rows for text in row.clocks.values())

    def at(self, reference_ns: int) -> Fleet:
        """The fleet with its clock times as seconds after a moment, UTC."""
        if not self.has_clock_times:
            return self
        zone = ZoneInfo(self.time_zone)
        rows = {
            "stops": tuple(stop.at(zone, reference_ns) for stop in self.stops),
            "vehicles": tuple(vehicle.at(zone, reference_ns) for vehicle in self.vehicles),
        }
        return Fleet(**{**self.parts, **rows})

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
    def hub_by_id(self) -> dict[str, Hub]:
        """Hubs by their id."""
        return {hub.id: hub for hub in self.hubs}

    @cached_property
    def vehicle_by_id(self) -> dict[str, Vehicle]:
        """Vehicles by their id."""
        return {vehicle.id: vehicle for vehicle in self.vehicles}

    @cached_property
    def break_ids(self) -> frozenset[str]:
        """Names that the stops for breaks have in plans; no other place may have them."""
        return frozenset(
            vehicle.break_id(number)
            for vehicle in self.vehicles
            for number in range(len(vehicle.breaks))
        )

    @cached_property
    def carriers(self) -> tuple[str | None, ...]:
        """Carriers of the vehicles, in their order; None: those without one."""
        return tuple(dict.fromkeys(vehicle.carrier for vehicle in self.vehicles))

    @cached_property
    def _types(self) -> dict[str, VehicleType]:
        return {**PRESETS, **{kind.id: kind for kind in self.vehicle_types}}

    @cached_property
    def pooled(self) -> tuple[str, ...]:
        """Ids of the stops that are on no vehicle."""
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

    def may_serve(self, vehicle: Vehicle, stop: Stop) -> bool:
        """Whether a vehicle is of the stop's carrier, has the skills that it needs, and is the one
        that it is kept for, where it names them.
        """
        return (
            stop.carrier in (None, vehicle.carrier)
            and stop.vehicle in (None, vehicle.id)
            and set(stop.skills) <= set(vehicle.skills)
        )

    def limits(self, vehicle: Vehicle) -> tuple[float, float]:
        """(units, mass in kg) that a vehicle carries at most, the mass with what rounding may add;
        inf: no limit.
        """
        kind = self.type_of(vehicle)
        payload_kg = None if kind is None else kind.payload_kg
        return (
            math.inf if vehicle.capacity is None else vehicle.capacity,
            math.inf if payload_kg is None else payload_kg + _TOLERANCE_KG,
        )

    def overload(self, vehicle: Vehicle, stops: Iterable[Stop]) -> str | None:
        """By what the load of some stops is more than a vehicle carries; None: it is not."""
        served = list(stops)
        units, kg = self.limits(vehicle)
        demand = sum(stop.demand for stop in served)
        if demand > units:
            return f"{demand}, more than its capacity of {vehicle.capacity}"
        mass_kg = math.fsum(stop.mass_kg for stop in served)
        kind = self.type_of(vehicle)
        if kind is not None and mass_kg > kg:
            return f"{mass_kg:g} kg, more than its payload of {kind.payload_kg:g} kg"
        return None

    def node(self, place: str) -> str:
        """Junction of a stop, a depot, a charging stop or a hub."""
        tables: tuple[Mapping[str, Place], ...] = (
            self.depot_by_id,
            self.charging_stop_by_id,
            self.hub_by_id,
        )
        for known in tables:
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

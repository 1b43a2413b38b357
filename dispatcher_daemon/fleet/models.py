"""Depots, stops, charging stops, hubs and vehicles of one dispatch."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Annotated, Any, Final, Self

from pydantic import Field, model_validator

from slipstream.config import Settings
from slipstream.messages import Identifier
from slipstream.vehicle_types import PRESETS, VehicleType

DEPOT: Final = "depot"
"""In the arc form this place stands for each vehicle's own depot; no stop may have its name."""

_DAY_S: Final = 86400.0
_TOLERANCE_KG: Final = 1e-6

Skills = Annotated[tuple[Identifier, ...], Field(max_length=50)]
"""Names of what a stop needs, or a vehicle has, such as "tail-lift"."""

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


class Hub(_Point):
    """Where vehicles may wait for each other on their way, such as a rest area."""

    id: Identifier
    node: Identifier = Field(description="Junction of the road network; or `lat` and `lon`.")


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
    carrier: Identifier | None = Field(
        default=None, description="Only vehicles of this carrier serve it; None: any vehicle."
    )
    skills: Skills = Field(default=(), description="Only vehicles with all of these serve it.")
    vehicle: Identifier | None = Field(
        default=None, description="Only this vehicle serves it; None: any vehicle."
    )

    @model_validator(mode="after")
    def _window_is_open(self) -> Self:
        if self.latest_s is not None and self.latest_s < self.earliest_s:
            raise ValueError(
                f"latest_s ({self.latest_s:g}) must not be below earliest_s ({self.earliest_s:g})"
            )
        return self

    @property
    def requirement(self) -> tuple[str | None, frozenset[str]]:
        """Carrier and skills that it asks for."""
        return self.carrier, frozenset(self.skills)


Place = Depot | Stop | ChargingStop | Hub


class Vehicle(Settings):
    """One vehicle.

    A vehicle with a first stop has that parcel loaded and drives there first. Stops that are
    nobody's first stop are pooled: any vehicle may serve them, or any of their carrier. It leaves
    its depot within [``ready_s``, ``depart_by_s``], s after the reference time of the cycle.
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
    carrier: Identifier | None = Field(
        default=None,
        description="Who runs it. Vehicles without one count together as one carrier.",
    )
    skills: Skills = Field(default=(), description="It can serve stops that need any of these.")

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

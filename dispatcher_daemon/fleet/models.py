"""Depots, stops, charging stops, hubs and vehicles of one dispatch."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Annotated, Any, Final, Self
from zoneinfo import ZoneInfo

from pydantic import Field, model_validator

from dispatcher_daemon.fleet.clock import Clock, ZoneName, seconds_after
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

    id: Identifier = Field(default=DEPOT, description="Its name.")
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

    Times in seconds count from the reference time of the cycle: when a vehicle that is ready at
    once leaves.
    """

    id: Identifier = Field(description="Its name, an order's: never used again for another one.")
    node: Identifier = Field(description="Junction of the road network; or `lat` and `lon`.")
    service_s: float = Field(
        default=60.0, ge=0, le=_DAY_S, allow_inf_nan=False, description="Time that service takes."
    )
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
    earliest: Clock | None = Field(
        default=None,
        description='Instead of `earliest_s`, in a fleet file: "08:30" of each day, or with a '
        'date, "2026-11-23T08:30:00+01:00".',
    )
    latest: Clock | None = Field(default=None, description="Instead of `latest_s`, likewise.")
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
    def clocks(self) -> dict[str, str | None]:
        """Its clock times, in the order in which they follow each other."""
        return {"earliest": self.earliest, "latest": self.latest}

    def at(self, zone: ZoneInfo, reference_ns: int) -> Stop:
        """The stop with its clock times as seconds after a moment; a window that has closed closes
        then.
        """
        after = seconds_after(self.clocks, zone, reference_ns)
        times = {f"{name}_s": min(max(value, 0.0), _DAY_S) for name, value in after.items()}
        earliest_s = times.get("earliest_s", self.earliest_s)
        if "latest_s" in times:
            times["latest_s"] = max(times["latest_s"], earliest_s)
        return self.model_copy(update=times) if times else self

    @property
    def requirement(self) -> tuple[str | None, frozenset[str]]:
        """Carrier and skills that it asks for."""
        return self.carrier, frozenset(self.skills)


Place = Depot | Stop | ChargingStop | Hub


class Break(Settings):
    """A time in which a vehicle stands and nobody works, between two stops of a tour."""

    duration_s: float = Field(gt=0, le=_DAY_S, allow_inf_nan=False, description="Its length.")
    earliest_s: float = Field(
        default=0.0, ge=-_DAY_S, le=_DAY_S, allow_inf_nan=False, description="Begins no sooner."
    )
    latest_s: float = Field(
        default=_DAY_S, ge=-_DAY_S, le=_DAY_S, allow_inf_nan=False, description="Begins no later."
    )
    earliest: Clock | None = Field(
        default=None,
        description='Instead of `earliest_s`, in a fleet file: "11:30" of each day, or with a '
        "date.",
    )
    latest: Clock | None = Field(default=None, description="Instead of `latest_s`, likewise.")

    @model_validator(mode="after")
    def _window_is_open(self) -> Self:
        if self.latest_s < self.earliest_s:
            raise ValueError(
                f"latest_s ({self.latest_s:g}) must not be below earliest_s ({self.earliest_s:g})"
            )
        return self

    @property
    def clocks(self) -> dict[str, str | None]:
        """Its clock times, in the order in which they follow each other."""
        return {"earliest": self.earliest, "latest": self.latest}

    def at(self, zone: ZoneInfo, reference_ns: int) -> Break:
        """The break with its clock times as seconds after a moment, below 0 before it."""
        after = seconds_after(self.clocks, zone, reference_ns)
        times = {f"{name}_s": min(max(s, -_DAY_S), _DAY_S) for name, s in after.items()}
        return self.model_copy(update=times) if times else self

    @property
    def over(self) -> Break:
        """The break in a window that closed long ago: it keeps its place among the others."""
        return self.model_copy(update={"earliest_s": -_DAY_S, "latest_s": -_DAY_S})


class Vehicle(Settings):
    """One vehicle.

    A vehicle with a first stop has that parcel loaded and drives there first. Stops that are
    nobody's first stop are pooled: any vehicle may serve them, or any of their carrier. It leaves
    its depot within [``ready_s``, ``depart_by_s``], s after the reference time of the cycle.
    """

    id: Identifier = Field(description="Its name, as its agent's.")
    depot: Identifier | None = Field(
        default=None, description="Where it starts and ends; None: the first depot."
    )
    first_stop: Identifier | None = Field(
        default=None, description="The stop whose parcel it has loaded and drives to first."
    )
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
    ready: Clock | None = Field(
        default=None,
        description='Instead of `ready_s`, in a fleet file: "07:00" of each day, or with a date.',
    )
    depart_by: Clock | None = Field(default=None, description="Instead of `depart_by_s`, likewise.")
    return_by: Clock | None = Field(default=None, description="Instead of `return_by_s`, likewise.")
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
    breaks: Annotated[tuple[Break, ...], Field(max_length=10)] = Field(
        default=(), description="In the order in which they are taken."
    )

    def break_id(self, number: int) -> str:
        """Name that the stop for one of its breaks has in plans.

        Args:
            number: of the break, from 0.
        """
        return f"{self.id} break {number + 1}"

    def breaks_at_depot(self, leaves_s: float, back_s: float) -> frozenset[int]:
        """Numbers of the breaks that a tour leaves to the time at the depot, before it or after it.

        They follow one another there too, so that each takes a time of its own.

        Args:
            leaves_s: when the tour begins, s as all times of the fleet.
            back_s: when it ends.
        """
        before, ended_s = 0, -math.inf
        for own in self.breaks:
            begins_s = max(own.earliest_s, ended_s)
            if begins_s + own.duration_s > leaves_s and own.latest_s >= leaves_s:
                break
            before, ended_s = before + 1, begins_s + own.duration_s
        # The last ones, as many as have room after it.
        after, begins_by_s = len(self.breaks), math.inf
        for own in reversed(self.breaks[before:]):
            begins_by_s = min(own.latest_s, begins_by_s - own.duration_s)
            if begins_by_s < max(back_s, own.earliest_s):
                break
            after -= 1
        return frozenset((*range(before), *range(after, len(self.breaks))))

    @property
    def clocks(self) -> dict[str, str | None]:
        """Its clock times, in the order in which they follow each other."""
        return {"ready": self.ready, "depart_by": self.depart_by, "return_by": self.return_by}

    def at(self, zone: ZoneInfo, reference_ns: int) -> Vehicle:
        """The vehicle with its clock times as seconds after a moment; what has passed is now."""
        after = seconds_after(self.clocks, zone, reference_ns)
        breaks = tuple(own.at(zone, reference_ns) for own in self.breaks)
        if not after:
            return self if breaks == self.breaks else self.model_copy(update={"breaks": breaks})
        ready_s = min(max(after.get("ready", self.ready_s), 0.0), _DAY_S)
        times = {f"{name}_s": max(value, ready_s) for name, value in after.items()}
        if "depart_by_s" in times:
            times["depart_by_s"] = min(times["depart_by_s"], _DAY_S)
        if "return_by_s" in times:
            times["return_by_s"] = min(times["return_by_s"], 2 * _DAY_S)
        return self.model_copy(update={**times, "ready_s": ready_s, "breaks": breaks})

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

"""The fleet: depots, stops and vehicles, read from a file and checked against the road network."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Final, Self

from pydantic import Field, model_validator

from slipstream.config import Settings, check, read_data
from slipstream.errors import InputError
from slipstream.messages import Identifier
from slipstream.roads import RoadNetwork

DEMO_FLEET = "demo"

DEPOT: Final = "depot"
"""In the arc form this place stands for each vehicle's own depot; no stop may have its name."""

_DAY_S: Final = 86400.0


class Depot(Settings):
    """Where vehicles start and end."""

    id: Identifier = DEPOT
    node: Identifier = Field(description="Junction of the road network.")


class Stop(Settings):
    """One delivery. Stops may share a junction with each other and with a depot.

    All times count from the reference time of the cycle: when a vehicle that is ready at once
    leaves.
    """

    id: Identifier
    node: Identifier = Field(description="Junction of the road network.")
    service_s: float = Field(default=60.0, ge=0, le=_DAY_S, allow_inf_nan=False)
    demand: int = Field(
        default=0, ge=0, le=10**9, description="What it takes of a vehicle's capacity."
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

    @cached_property
    def stop_by_id(self) -> dict[str, Stop]:
        """Stops by their id."""
        return {stop.id: stop for stop in self.stops}

    @cached_property
    def depot_by_id(self) -> dict[str, Depot]:
        """Depots by their id."""
        return {depot.id: depot for depot in self.depots}

    @cached_property
    def pooled(self) -> tuple[str, ...]:
        """Ids of the stops that any vehicle may serve."""
        taken = {vehicle.first_stop for vehicle in self.vehicles}
        return tuple(stop.id for stop in self.stops if stop.id not in taken)

    def depot_of(self, vehicle: Vehicle) -> Depot:
        """Where a vehicle starts and ends."""
        return self.depots[0] if vehicle.depot is None else self.depot_by_id[vehicle.depot]

    def node(self, place: str) -> str:
        """Junction of a stop or of a depot."""
        depot = self.depot_by_id.get(place)
        return self.stop_by_id[place].node if depot is None else depot.node

    def service_s(self, place: str) -> float:
        """Time spent at a stop; none at a depot."""
        return 0.0 if place in self.depot_by_id else self.stop_by_id[place].service_s

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

    In it every vehicle drives, stops have no times, and no load is counted. A capacity that no
    set of stops can exceed is no obstacle, nor is a departure window: vehicles then leave when
    they are ready.
    """
    for stop in fleet.stops:
        if stop.earliest_s > 0 or stop.latest_s is not None:
            return f"stop {stop.id!r} has a time window"
    demand = {stop.id: stop.demand for stop in fleet.stops}
    pooled = sum(demand[name] for name in fleet.pooled)
    for vehicle in fleet.vehicles:
        if vehicle.return_by_s is not None:
            return f"vehicle {vehicle.id!r} has to be back in time"
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
    """Check plain data as a fleet; errors as in `load_fleet`."""
    fleet = check(data, Fleet, source)
    check_fleet(fleet, network, source)
    return fleet


def check_fleet(fleet: Fleet, network: RoadNetwork, source: str | Path, prefix: str = "") -> None:
    """Check what a fleet refers to. Stops that cannot be served are no fault of the file's:
    `dispatcher_daemon.planning.servability.unservable` names them.

    Args:
        source: what errors name.
        prefix: put before the keys in errors, where the fleet is part of a larger file.

    Raises:
        InputError: a duplicate id, an unknown node or depot, or a first stop that does not exist
            or is claimed twice.
    """
    _no_duplicates(source, f"{prefix}depots", "id", (d.id for d in fleet.depots))
    _no_duplicates(source, f"{prefix}stops", "id", (s.id for s in fleet.stops))
    _no_duplicates(source, f"{prefix}vehicles", "id", (v.id for v in fleet.vehicles))
    for name in (DEPOT, *fleet.depot_by_id):
        if name in fleet.stop_by_id:
            raise InputError(
                source, "a stop has a depot's id", "rename it", key=f"{prefix}stops.{name}"
            )
    for place, node in (
        *((f"depots.{d.id}", d.node) for d in fleet.depots),
        *((f"stops.{s.id}", s.node) for s in fleet.stops),
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
    first = [v.first_stop for v in fleet.vehicles if v.first_stop is not None]
    mend = "give each vehicle a stop of its own"
    _no_duplicates(source, f"{prefix}vehicles", "first_stop", first, mend)


def _no_duplicates(
    source: str | Path, table: str, key: str, values: Iterable[str], mend: str = "rename one"
) -> None:
    for value, count in Counter(values).items():
        if count > 1:
            what = table.rpartition(".")[2]
            raise InputError(source, f"{count} {what} with {key} {value!r}", mend, key=table)

"""The fleet: depot, stops and vehicles, read from TOML and checked against the road network."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from functools import cached_property
from importlib import resources
from pathlib import Path

from pydantic import Field

from dispatcher_daemon.paths import least_cost_paths
from slipstream.config import Settings, check, load
from slipstream.errors import InputError
from slipstream.messages import Identifier
from slipstream.roads import RoadNetwork

DEMO_FLEET = "demo"


class Depot(Settings):
    """Where all vehicles start and end."""

    id: Identifier = "depot"
    node: Identifier = Field(description="Junction of the road network.")


class Stop(Settings):
    """One delivery."""

    id: Identifier
    node: Identifier = Field(description="Junction of the road network.")
    service_s: float = Field(default=60.0, ge=0, le=86400, allow_inf_nan=False)


class Vehicle(Settings):
    """One vehicle at the depot.

    A vehicle with a first stop has that parcel loaded and drives there first. Stops that are
    nobody's first stop are pooled: any vehicle may serve them.
    """

    id: Identifier
    first_stop: Identifier | None = None
    ready_s: float = Field(
        default=0.0, ge=0, le=86400, allow_inf_nan=False, description="Leaves this much later."
    )


class Fleet(Settings):
    """Depot, stops and vehicles of one dispatch."""

    name: str = "fleet"
    depot: Depot
    stops: tuple[Stop, ...] = Field(min_length=1)
    vehicles: tuple[Vehicle, ...] = Field(min_length=1)

    @cached_property
    def stop_by_id(self) -> dict[str, Stop]:
        """Stops by their id."""
        return {stop.id: stop for stop in self.stops}

    @cached_property
    def pooled(self) -> tuple[str, ...]:
        """Ids of the stops that any vehicle may serve."""
        taken = {vehicle.first_stop for vehicle in self.vehicles}
        return tuple(stop.id for stop in self.stops if stop.id not in taken)

    def node(self, place: str) -> str:
        """Junction of a stop or of the depot."""
        return self.depot.node if place == self.depot.id else self.stop_by_id[place].node

    def service_s(self, place: str) -> float:
        """Time spent at a stop; none at the depot."""
        return 0.0 if place == self.depot.id else self.stop_by_id[place].service_s

    def legs(self, vehicle: Vehicle) -> tuple[tuple[str, str], ...]:
        """Candidate arcs (from, to) of one vehicle over depot and stops.

        With f pooled stops these are f² + f + 2 for a vehicle that has a first stop and f² + f for
        one that has none.
        """
        depot, pooled = self.depot.id, self.pooled
        between = [(i, j) for i in pooled for j in pooled if i != j]
        back = [(i, depot) for i in pooled]
        if vehicle.first_stop is None:
            return tuple([(depot, j) for j in pooled] + between + back)
        first = vehicle.first_stop
        out = [(depot, first), (first, depot)]
        return tuple(out + [(first, j) for j in pooled] + between + back)


def load_fleet(reference: str | Path, network: RoadNetwork) -> Fleet:
    """Read a fleet.

    Args:
        reference: path of a TOML file, or ``"demo"`` for the fleet that is built in.
        network: the roads that its nodes lie on.

    Raises:
        InputError: the file is missing or malformed, or the fleet cannot be dispatched on the
            network (see `check_fleet`).
    """
    if str(reference) == DEMO_FLEET:
        packed = resources.files("dispatcher_daemon") / "data" / "demo_fleet.toml"
        with resources.as_file(packed) as path:
            fleet = load(path, Fleet)
    else:
        fleet = load(Path(reference), Fleet)
    check_fleet(fleet, network, reference)
    return fleet


def fleet_from(data: object, network: RoadNetwork, source: str) -> Fleet:
    """Check plain data as a fleet; errors as in `load_fleet`."""
    fleet = check(data, Fleet, source)
    check_fleet(fleet, network, source)
    return fleet


def check_fleet(fleet: Fleet, network: RoadNetwork, source: str | Path) -> None:
    """Check that a fleet can be dispatched on a network.

    Raises:
        InputError: a duplicate id, an unknown or shared node, a first stop that does not exist or
            is claimed twice, a vehicle that would have nothing to do, or a stop that cannot be
            reached from the depot and left again.
    """
    _no_duplicates(source, "stops", "id", (s.id for s in fleet.stops))
    _no_duplicates(source, "vehicles", "id", (v.id for v in fleet.vehicles))
    if fleet.depot.id in fleet.stop_by_id:
        raise InputError(source, "a stop has the depot's id", "rename it", key=fleet.depot.id)
    for place, node in (
        ("depot", fleet.depot.node),
        *((f"stops.{s.id}", s.node) for s in fleet.stops),
    ):
        if node not in network.junctions:
            raise InputError(
                source,
                f"unknown node {node!r}",
                f"use a junction of network {network.name!r}",
                key=f"{place}.node",
            )
    nodes = (fleet.depot.node, *(s.node for s in fleet.stops))
    _no_duplicates(source, "stops", "node", nodes, "merge the stops, or move one off the depot")
    _check_first_stops(fleet, source)
    _check_reachable(fleet, network, source)


def _no_duplicates(
    source: str | Path, table: str, key: str, values: Iterable[str], mend: str = "rename one"
) -> None:
    for value, count in Counter(values).items():
        if count > 1:
            raise InputError(source, f"{count} {table} with {key} {value!r}", mend, key=table)


def _check_first_stops(fleet: Fleet, source: str | Path) -> None:
    first = [v.first_stop for v in fleet.vehicles if v.first_stop is not None]
    for vehicle in fleet.vehicles:
        if vehicle.first_stop is not None and vehicle.first_stop not in fleet.stop_by_id:
            raise InputError(
                source,
                f"no stop {vehicle.first_stop!r}",
                "name one of the stops",
                key=f"vehicles.{vehicle.id}.first_stop",
            )
    _no_duplicates(source, "vehicles", "first_stop", first, "give each vehicle a stop of its own")
    free = len(fleet.vehicles) - len(first)
    if free > len(fleet.pooled):
        raise InputError(
            source,
            f"{free} vehicles without a first stop for {len(fleet.pooled)} pooled stops",
            "remove vehicles: each one that is named must drive",
            key="vehicles",
        )


def _check_reachable(fleet: Fleet, network: RoadNetwork, source: str | Path) -> None:
    nodes = [fleet.depot.node, *(s.node for s in fleet.stops)]
    paths = least_cost_paths(network, dict.fromkeys(network.segments, 1.0), nodes, nodes)
    for stop in fleet.stops:
        for start, end, what in (
            (fleet.depot.node, stop.node, "reached from"),
            (stop.node, fleet.depot.node, "left for"),
        ):
            if (start, end) not in paths:
                raise InputError(
                    source,
                    f"node {stop.node!r} cannot be {what} the depot",
                    "move the stop or mend the network",
                    key=f"stops.{stop.id}.node",
                )

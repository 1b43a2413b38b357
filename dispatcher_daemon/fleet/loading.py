"""A fleet read from a file and checked against the road network."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable
from importlib import resources
from pathlib import Path

from dispatcher_daemon.fleet.models import DEPOT, Fleet, Vehicle
from dispatcher_daemon.fleet.places import distances, located, with_unknown_nodes
from slipstream.config import check, read_data
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.vehicle_types import PRESETS

log = logging.getLogger(__name__)

DEMO_FLEET = "demo"


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


def fleet_from(
    data: object, network: RoadNetwork, source: str | Path, *, may_lack_stops: bool = False
) -> Fleet:
    """Check plain data as a fleet; errors as in `load_fleet`, also where it has no stop and may not
    lack them.

    A place with latitude and longitude gets a node: the nearer end of the nearest road that some
    vehicle of the fleet may use, no more than `MAX_SNAP_M` away.
    """
    fleet = located(check(with_unknown_nodes(data), Fleet, source), network, source)
    if not (fleet.stops or may_lack_stops):
        raise InputError(source, "no stop", "add one", key="stops")
    check_fleet(fleet, network, source)
    furthest = max(
        distances(fleet, network, source), key=lambda found: found[1].distance_m, default=None
    )
    if furthest is not None:
        key, snapped = furthest
        log.info("%s: places lie at most %.0f m from roads (%s)", source, snapped.distance_m, key)
    return fleet


def check_fleet(fleet: Fleet, network: RoadNetwork, source: str | Path, prefix: str = "") -> None:
    """Check what a fleet refers to. Stops that cannot be served are no fault of the file's:
    `dispatcher_daemon.planning.servability.unservable` names them.

    Args:
        source: what errors name.
        prefix: put before the keys in errors, where the fleet is part of a larger file.

    Raises:
        InputError: a duplicate id, an unknown node, depot or vehicle type, a charge that does not
            fit the battery, a first stop that does not exist, is claimed twice or is for other
            vehicles, or a stop for which the fleet has no vehicle.
    """
    _no_duplicates(source, f"{prefix}depots", "id", (d.id for d in fleet.depots))
    _no_duplicates(source, f"{prefix}stops", "id", (s.id for s in fleet.stops))
    _no_duplicates(source, f"{prefix}vehicles", "id", (v.id for v in fleet.vehicles))
    _no_duplicates(source, f"{prefix}vehicle_types", "id", (t.id for t in fleet.vehicle_types))
    _no_duplicates(source, f"{prefix}charging_stops", "id", (c.id for c in fleet.charging_stops))
    _no_duplicates(source, f"{prefix}hubs", "id", (h.id for h in fleet.hubs))
    for name in (DEPOT, *fleet.depot_by_id):
        if name in fleet.stop_by_id:
            raise InputError(
                source, "a stop has a depot's id", "rename it", key=f"{prefix}stops.{name}"
            )
    for name in fleet.charging_stop_by_id:
        if name == DEPOT or name in fleet.stop_by_id or name in fleet.depot_by_id:
            problem = "a charging stop has the id of a stop or depot"
            raise InputError(source, problem, "rename it", key=f"{prefix}charging_stops.{name}")
    for name in fleet.hub_by_id:
        others = (fleet.stop_by_id, fleet.depot_by_id, fleet.charging_stop_by_id)
        if name == DEPOT or any(name in other for other in others):
            problem = "a hub has the id of a stop, charging stop or depot"
            raise InputError(source, problem, "rename it", key=f"{prefix}hubs.{name}")
    for kind in fleet.vehicle_types:
        if kind.id in PRESETS:
            key = f"{prefix}vehicle_types.{kind.id}"
            raise InputError(source, "a vehicle type has a preset's id", "rename it", key=key)
    for place, node in (
        *((f"depots.{d.id}", d.node) for d in fleet.depots),
        *((f"stops.{s.id}", s.node) for s in fleet.stops),
        *((f"charging_stops.{c.id}", c.node) for c in fleet.charging_stops),
        *((f"hubs.{h.id}", h.node) for h in fleet.hubs),
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
    _check_carriers(fleet, source, prefix)
    first = [v.first_stop for v in fleet.vehicles if v.first_stop is not None]
    mend = "give each vehicle a stop of its own"
    _no_duplicates(source, f"{prefix}vehicles", "first_stop", first, mend)


def _check_carriers(fleet: Fleet, source: str | Path, prefix: str) -> None:
    for stop in fleet.stops:
        if stop.carrier is not None and stop.carrier not in fleet.carriers:
            raise InputError(
                source,
                f"no vehicle of carrier {stop.carrier!r}",
                "give that carrier a vehicle, or leave the stop's carrier out for any vehicle",
                key=f"{prefix}stops.{stop.id}.carrier",
            )
        key = f"{prefix}stops.{stop.id}"
        if stop.vehicle is not None and stop.vehicle not in fleet.vehicle_by_id:
            mend = "name one of the vehicles"
            raise InputError(source, f"no vehicle {stop.vehicle!r}", mend, key=f"{key}.vehicle")
        if not any(fleet.may_serve(vehicle, stop) for vehicle in fleet.vehicles):
            problem = f"no vehicle has all the skills {', '.join(stop.skills)}"
            if stop.carrier is not None or stop.vehicle is not None:
                problem = "no vehicle meets its carrier, skills and vehicle together"
            mend = "give a vehicle what the stop needs, or ask less"
            raise InputError(source, problem, mend, key=f"{key}.skills")
    for vehicle in fleet.vehicles:
        if vehicle.first_stop is None:
            continue
        stop = fleet.stop_by_id[vehicle.first_stop]
        if not fleet.may_serve(vehicle, stop):
            problem = f"stop {stop.id!r} is for other vehicles"
            if stop.carrier not in (None, vehicle.carrier):
                problem = f"stop {stop.id!r} is of carrier {stop.carrier!r}, and the vehicle is not"
            raise InputError(
                source,
                problem,
                "give the vehicle what the stop asks for, or another first stop",
                key=f"{prefix}vehicles.{vehicle.id}.first_stop",
            )


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

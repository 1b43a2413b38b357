"""A fleet read from a file and checked against the road network."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Iterator
from datetime import datetime
from importlib import resources
from itertools import pairwise
from pathlib import Path
from zoneinfo import ZoneInfo

from dispatcher_daemon.fleet.clock import given_twice, parse_clock
from dispatcher_daemon.fleet.models import Fleet
from dispatcher_daemon.fleet.places import located, served, with_unknown_nodes
from dispatcher_daemon.fleet.stops import DEPOT, Place, Stop
from dispatcher_daemon.fleet.vehicles import Break, Vehicle
from slipstream.config import check, read_data
from slipstream.errors import InputError, refuse
from slipstream.roads import RoadNetwork
from slipstream.roads.snapping import NO_CLASSES, lacks_classes
from slipstream.vehicle_types import PRESETS

log = logging.getLogger(__name__)

DEMO_FLEET = "demo"


def load_fleet(reference: str | Path, network: RoadNetwork | None) -> Fleet:
    """Read a fleet.

    Args:
        reference: path of a TOML or JSON file, or ``"demo"`` for the fleet that is built in.
        network: the roads that its nodes lie on; None: they are not known.

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
    data: object,
    network: RoadNetwork | None,
    source: str | Path,
    *,
    may_lack_stops: bool = False,
    may_have_clock_times: bool = False,
) -> Fleet:
    """Check plain data as a fleet; errors as in `load_fleet`, also where it has no stop and may not
    lack them, or clock times and may not have them.

    A place with latitude and longitude gets a node: an end of the nearest road where some vehicle
    of the fleet may stop (`slipstream.roads.snapping`).

    Args:
        network: the roads; None: they are not known, and nothing is compared with them.
        may_have_clock_times: its times may be of a day.
    """
    fleet = check(with_unknown_nodes(data), Fleet, source)
    if network is not None:
        fleet = located(fleet, network, source)
    if not (fleet.stops or may_lack_stops):
        raise InputError(source, "no stop", "add one", key="stops")
    refuse(_clock_faults(fleet, source, may_have_clock_times))
    check_fleet(fleet, network, source)
    if network is None:
        return fleet
    furthest = max(served(fleet, network), key=lambda place: place.to_node_m, default=None)
    if furthest is not None:
        log.info("%s: of all places the furthest off: %s", source, furthest)
        if lacks_classes(network):
            log.warning("network %r: %s", network.name, NO_CLASSES)
    return fleet


def _clock_faults(fleet: Fleet, source: str | Path, allowed: bool) -> Iterator[InputError]:
    """Clock times that are given in seconds too, or where times count from no known moment."""
    tables: dict[str, tuple[Stop | Vehicle, ...]] = {
        "stops": fleet.stops,
        "vehicles": fleet.vehicles,
    }
    keyed: list[tuple[str, Stop | Vehicle | Break]] = [
        (f"{table}.{row.id}", row) for table, rows in tables.items() for row in rows
    ]
    for vehicle in fleet.vehicles:
        key = f"vehicles.{vehicle.id}.breaks"
        keyed += [(f"{key}.{number}", own) for number, own in enumerate(vehicle.breaks)]
    if fleet.has_clock_times:
        for key, row in keyed:
            yield from given_twice(row.clocks, row.model_fields_set, source, key)
            for name, text in row.clocks.items() if not allowed else ():
                if text is not None:
                    problem = "a clock time, which only a fleet file of the dispatcher has"
                    yield InputError(source, problem, f"give {name}_s", key=f"{key}.{name}")


def check_fleet(
    fleet: Fleet, network: RoadNetwork | None, source: str | Path, prefix: str = ""
) -> None:
    """Check what a fleet refers to. Stops that cannot be served are no fault of the file's:
    `dispatcher_daemon.planning.routes.servability.unservable` names them.

    Args:
        prefix: put before the keys in errors, where the fleet is part of a larger file.

    Raises:
        InputError: a duplicate id, an unknown node, depot or vehicle type, a charge that does not
            fit the battery, a first stop that does not exist, is claimed twice or is for other
            vehicles, or a stop for which the fleet has no vehicle.
    """
    refuse(_faults(fleet, network, source, prefix))


def _faults(
    fleet: Fleet, network: RoadNetwork | None, source: str | Path, prefix: str
) -> Iterator[InputError]:
    places: dict[str, tuple[Place, ...]] = {
        "depots": fleet.depots,
        "stops": fleet.stops,
        "charging_stops": fleet.charging_stops,
        "hubs": fleet.hubs,
    }
    taken = {DEPOT: "depot"}
    for table, rows in places.items():
        kind = table.removesuffix("s").replace("_", " ")
        yield from _no_duplicates(source, f"{prefix}{table}", "id", (row.id for row in rows))
        for row in rows:
            key = f"{prefix}{table}.{row.id}"
            if (other := taken.setdefault(row.id, kind)) != kind:
                yield InputError(source, f"a {kind} has a {other}'s id", "rename it", key=key)
            if row.id in fleet.break_ids:
                problem = "it has the name that a vehicle's break has in plans"
                yield InputError(source, problem, "rename it", key=key)
            if network is not None and row.node not in network.junctions:
                mend = f"use a junction of network {network.name!r}"
                yield InputError(source, f"unknown node {row.node!r}", mend, key=f"{key}.node")
    for table, ids in (
        ("vehicles", [vehicle.id for vehicle in fleet.vehicles]),
        ("vehicle_types", [kind.id for kind in fleet.vehicle_types]),
    ):
        yield from _no_duplicates(source, f"{prefix}{table}", "id", ids)
    for own in fleet.vehicle_types:
        if own.id in PRESETS:
            key = f"{prefix}vehicle_types.{own.id}"
            yield InputError(source, "a vehicle type has a preset's id", "rename it", key=key)
    for vehicle in fleet.vehicles:
        key = f"{prefix}vehicles.{vehicle.id}"
        if vehicle.depot is not None and vehicle.depot not in fleet.depot_by_id:
            problem, mend = f"no depot {vehicle.depot!r}", "name one of the depots"
            yield InputError(source, problem, mend, key=f"{key}.depot")
        if vehicle.first_stop is not None and vehicle.first_stop not in fleet.stop_by_id:
            problem, mend = f"no stop {vehicle.first_stop!r}", "name one of the stops"
            yield InputError(source, problem, mend, key=f"{key}.first_stop")
        yield from _check_type(fleet, vehicle, source, key)
        yield from _break_faults(fleet, vehicle, source, key)
    yield from _check_carriers(fleet, source, prefix)
    first = [v.first_stop for v in fleet.vehicles if v.first_stop is not None]
    mend = "give each vehicle a stop of its own"
    yield from _no_duplicates(source, f"{prefix}vehicles", "first_stop", first, mend)


def _check_carriers(fleet: Fleet, source: str | Path, prefix: str) -> Iterator[InputError]:
    for stop in fleet.stops:
        if stop.carrier is not None and stop.carrier not in fleet.carriers:
            yield InputError(
                source,
                f"no vehicle of carrier {stop.carrier!r}",
                "give that carrier a vehicle, or leave the stop's carrier out for any vehicle",
                key=f"{prefix}stops.{stop.id}.carrier",
            )
            continue
        key = f"{prefix}stops.{stop.id}"
        if stop.vehicle is not None and stop.vehicle not in fleet.vehicle_by_id:
            mend = "name one of the vehicles"
            yield InputError(source, f"no vehicle {stop.vehicle!r}", mend, key=f"{key}.vehicle")
        elif not any(fleet.may_serve(vehicle, stop) for vehicle in fleet.vehicles):
            problem = f"no vehicle has all the skills {', '.join(stop.skills)}"
            if stop.carrier is not None or stop.vehicle is not None:
                problem = "no vehicle meets its carrier, skills and vehicle together"
            mend = "give a vehicle what the stop needs, or ask less"
            yield InputError(source, problem, mend, key=f"{key}.skills")
    for vehicle in fleet.vehicles:
        if vehicle.first_stop is None:
            continue
        first = fleet.stop_by_id.get(vehicle.first_stop)
        if first is not None and not fleet.may_serve(vehicle, first):
            problem = f"stop {first.id!r} is for other vehicles"
            if first.carrier not in (None, vehicle.carrier):
                carrier = first.carrier
                problem = f"stop {first.id!r} is of carrier {carrier!r}, and the vehicle is not"
            yield InputError(
                source,
                problem,
                "give the vehicle what the stop asks for, or another first stop",
                key=f"{prefix}vehicles.{vehicle.id}.first_stop",
            )


def _check_type(
    fleet: Fleet, vehicle: Vehicle, source: str | Path, key: str
) -> Iterator[InputError]:
    known = [*PRESETS, *(kind.id for kind in fleet.vehicle_types)]
    if vehicle.type is not None and vehicle.type not in known:
        mend = f"use one of {', '.join(known)}"
        yield InputError(source, f"no vehicle type {vehicle.type!r}", mend, key=f"{key}.type")
    kind = fleet.type_of(vehicle)
    capacity_kwh = None if kind is None else kind.battery_kwh
    if vehicle.charge_kwh is None:
        return
    if capacity_kwh is None:
        problem, mend = "a charge without a battery", "give its type a battery_kwh"
        yield InputError(source, problem, mend, key=f"{key}.charge_kwh")
    elif vehicle.charge_kwh > capacity_kwh:
        problem = f"{vehicle.charge_kwh:g} kWh in a battery of {capacity_kwh:g} kWh"
        yield InputError(source, problem, "give what is in it", key=f"{key}.charge_kwh")


def _no_duplicates(
    source: str | Path, table: str, key: str, values: Iterable[str], mend: str = "rename one"
) -> Iterator[InputError]:
    for value, count in Counter(values).items():
        if count > 1:
            what = table.rpartition(".")[2]
            yield InputError(source, f"{count} {what} with {key} {value!r}", mend, key=table)


def _break_faults(
    fleet: Fleet, vehicle: Vehicle, source: str | Path, key: str
) -> Iterator[InputError]:
    """Breaks whose windows overlap and have no room for both, one after the other."""
    breaks = vehicle.breaks_at(ZoneInfo(fleet.time_zone), 0)
    for number, (first, second) in enumerate(pairwise(vehicle.breaks), 1):
        clocks = (*first.clocks.values(), *second.clocks.values())
        if any(text is not None and isinstance(parse_clock(text), datetime) for text in clocks):
            continue  # Their distance is another one each day.
        one, other = breaks[number - 1], breaks[number]
        apart = one.latest_s < other.earliest_s or other.latest_s < one.earliest_s
        if not apart and one.earliest_s + one.duration_s > other.latest_s:
            problem = "it cannot begin in its window after the break before, which overlaps it"
            mend = "list it before that one, give it a later window, or make one break of both"
            yield InputError(source, problem, mend, key=f"{key}.breaks.{number}")

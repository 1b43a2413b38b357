"""Parts of a cycle's inputs as data that JSON can hold, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, asdict, fields, replace
from types import MappingProxyType
from typing import Any, Final

from pydantic import TypeAdapter

from dispatcher_daemon.fleet import (
    ChargingStop,
    Commitment,
    Depot,
    Fleet,
    Hub,
    NamedVehicleType,
    Stop,
    Vehicle,
)
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic import Expectations, SegmentTraffic, planning_speed_mps
from slipstream.messages import VehiclePlan
from slipstream.roads import RoadNetwork

PlanOf = Callable[[int, str], VehiclePlan | None]
"""A vehicle's plan from a cycle; None: it is not stored any more."""

_NOT_OF_A_CYCLE: Final = {"bus", "service", "database_url", "rsus"}
"""Settings that no plan depends on; a URL may hold a password."""
_TABLES: Final[Mapping[str, TypeAdapter[Any]]] = {
    "depots": TypeAdapter(tuple[Depot, ...]),
    "vehicle_types": TypeAdapter(tuple[NamedVehicleType, ...]),
    "charging_stops": TypeAdapter(tuple[ChargingStop, ...]),
    "hubs": TypeAdapter(tuple[Hub, ...]),
    "vehicles": TypeAdapter(tuple[Vehicle, ...]),
    "stops": TypeAdapter(tuple[Stop, ...]),
}
_COMMITMENT: Final = TypeAdapter(Commitment)
_TRAFFIC: Final = {f.name: f.default for f in fields(SegmentTraffic) if f.default is not MISSING}
"""Defaults of what a segment's traffic has beside its speed."""


def settings_data(settings: DispatcherSettings) -> dict[str, Any]:
    """The settings that plans depend on."""
    return settings.model_dump(mode="json", exclude=_NOT_OF_A_CYCLE)


def places_data(fleet: Fleet) -> dict[str, Any]:
    """A fleet's name, places and vehicle types."""
    names = _TABLES.keys() - {"vehicles", "stops"}
    return {"name": fleet.name} | {n: table_data(n, getattr(fleet, n)) for n in sorted(names)}


def table_data(name: str, rows: object) -> object:
    """A fleet's rows of one kind."""
    return _TABLES[name].dump_python(rows, mode="json", exclude_defaults=True)


def fleet_from_parts(parts: Mapping[str, Any]) -> Fleet:
    """The fleet of places, vehicles and stops."""
    rows = {**parts["places"], "vehicles": parts["vehicles"], "stops": parts["stops"]}
    tables = {name: adapter.validate_python(rows[name]) for name, adapter in _TABLES.items()}
    # As it was made: the fleet of vehicles on their way home has no stop.
    return Fleet.model_construct(name=rows["name"], **tables)


def expected_data(expected: Expectations | None) -> object:
    """Expected costs of movements."""
    if expected is None:
        return None
    tables = (expected.loss_kwh, expected.seconds, expected.stops)
    return [[[a, b, value] for (a, b), value in table.items()] for table in tables]


def expected_from(data: Any) -> Expectations | None:
    """The costs of `expected_data`."""
    if data is None:
        return None
    return Expectations(*({(a, b): value for a, b, value in table} for table in data))


def traffic_data(
    network: RoadNetwork, segments: Mapping[str, SegmentTraffic]
) -> dict[str, list[Any]]:
    """The traffic that a cycle was planned with, learned or judged: values by field, each list in
    the order of the network's segments. Fields that have their default everywhere are left out, as
    are speeds that follow from what was measured.
    """
    columns: dict[str, list[Any]] = {}
    for name, default in _TRAFFIC.items():
        values = [getattr(segments[segment], name) for segment in network.segments]
        if any(value != default for value in values):
            columns[name] = values
    speeds_mps = [
        None
        if segments[name].speed_mps == planning_speed_mps(road, segments[name].measured_speed_mps)
        else segments[name].speed_mps
        for name, road in network.segments.items()
    ]
    if any(speed_mps is not None for speed_mps in speeds_mps):
        columns["speed_mps"] = speeds_mps
    return columns


def traffic_from(
    network: RoadNetwork, columns: Mapping[str, Sequence[Any]]
) -> Mapping[str, SegmentTraffic]:
    """The traffic of `traffic_data`."""
    if any(len(values) != len(network.segments) for values in columns.values()):
        raise ValueError("its traffic is not that of its roads")
    found = {}
    for at, (name, road) in enumerate(network.segments.items()):
        known = {field: values[at] for field, values in columns.items()}
        speed_mps = known.pop("speed_mps", None)
        if speed_mps is None:
            speed_mps = planning_speed_mps(road, known.get("measured_speed_mps"))
        found[name] = SegmentTraffic(name, speed_mps, **known)
    return MappingProxyType(found)


def commitment_data(own: Commitment) -> dict[str, Any]:
    """A commitment; its plan is stored already."""
    return {**asdict(replace(own, plan=None)), "plan": own.plan.cycle}  # type: ignore[arg-type]


def commitment_from(data: dict[str, Any], plan_of: PlanOf) -> Commitment:
    """The commitment of `commitment_data`."""
    plan = plan_from(plan_of, data["plan"], data["vehicle"])
    return _COMMITMENT.validate_python({**data, "plan": plan})


def plan_from(plan_of: PlanOf, cycle: int, vehicle: str) -> VehiclePlan:
    """A plan that is stored."""
    plan = plan_of(cycle, vehicle)
    if plan is None:
        raise ValueError(f"the plan that {vehicle} followed, of cycle {cycle}, is not stored")
    return plan

"""The fleet: depots, stops and vehicles, read from a file and checked against the road network."""

from __future__ import annotations

from dispatcher_daemon.fleet.loading import DEMO_FLEET, check_fleet, fleet_from, load_fleet
from dispatcher_daemon.fleet.models import Fleet
from dispatcher_daemon.fleet.places import (
    located,
    served,
    snapper_of,
    to_node_m,
    with_unknown_nodes,
)
from dispatcher_daemon.fleet.stops import DEPOT, ChargingStop, Depot, Hub, Stop
from dispatcher_daemon.fleet.vehicles import Break, NamedVehicleType, Vehicle

__all__ = [
    "DEMO_FLEET",
    "DEPOT",
    "Break",
    "ChargingStop",
    "Depot",
    "Fleet",
    "Hub",
    "NamedVehicleType",
    "Stop",
    "Vehicle",
    "check_fleet",
    "fleet_from",
    "load_fleet",
    "located",
    "served",
    "snapper_of",
    "to_node_m",
    "with_unknown_nodes",
]

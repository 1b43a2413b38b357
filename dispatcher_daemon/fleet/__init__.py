"""The fleet: depots, stops and vehicles, read from a file and checked against the road network."""

from __future__ import annotations

from dispatcher_daemon.fleet.loading import DEMO_FLEET, check_fleet, fleet_from, load_fleet
from dispatcher_daemon.fleet.models import Fleet
from dispatcher_daemon.fleet.places import (
    MAX_SNAP_M,
    distances,
    located,
    snapper_of,
    with_unknown_nodes,
)
from dispatcher_daemon.fleet.stops import DEPOT, ChargingStop, Depot, Hub, Stop
from dispatcher_daemon.fleet.vehicles import Break, NamedVehicleType, Vehicle

__all__ = [
    "DEMO_FLEET",
    "DEPOT",
    "MAX_SNAP_M",
    "Break",
    "ChargingStop",
    "Depot",
    "Fleet",
    "Hub",
    "NamedVehicleType",
    "Stop",
    "Vehicle",
    "check_fleet",
    "distances",
    "fleet_from",
    "load_fleet",
    "located",
    "snapper_of",
    "with_unknown_nodes",
]

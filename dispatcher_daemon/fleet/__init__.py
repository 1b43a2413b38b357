"""The fleet: depots, stops and vehicles, read from a file and checked against the road network."""

from __future__ import annotations

from dispatcher_daemon.fleet.clock import clock_moments, parse_clock
from dispatcher_daemon.fleet.commitments import Commitment
from dispatcher_daemon.fleet.file import FleetFile
from dispatcher_daemon.fleet.loading import DEMO_FLEET, check_fleet, fleet_from, load_fleet
from dispatcher_daemon.fleet.models import Fleet
from dispatcher_daemon.fleet.places import (
    located,
    served,
    snapper_of,
    to_node_m,
    with_unknown_nodes,
)
from dispatcher_daemon.fleet.road_users import Passage, RoadUser, on_road
from dispatcher_daemon.fleet.stops import DEPOT, ChargingStop, Depot, Hub, Stop
from dispatcher_daemon.fleet.vehicles import Break, NamedVehicleType, Vehicle

__all__ = [
    "DEMO_FLEET",
    "DEPOT",
    "Break",
    "ChargingStop",
    "Commitment",
    "Depot",
    "Fleet",
    "FleetFile",
    "Hub",
    "NamedVehicleType",
    "Passage",
    "RoadUser",
    "Stop",
    "Vehicle",
    "check_fleet",
    "clock_moments",
    "fleet_from",
    "load_fleet",
    "located",
    "on_road",
    "parse_clock",
    "served",
    "snapper_of",
    "to_node_m",
    "with_unknown_nodes",
]

"""The fleet as the dispatcher knows it: orders, plans and vehicles by their messages.

Nothing here reads a clock, the bus or the database: the daemon and the simulation use it alike.
"""

from __future__ import annotations

from dispatcher_daemon.fleet.tracking.claims import Claim
from dispatcher_daemon.fleet.tracking.lateness import at_risk, lateness, lateness_s
from dispatcher_daemon.fleet.tracking.open_tours import OpenTour, fleet_of
from dispatcher_daemon.fleet.tracking.order_stops import (
    NO_PLACE,
    NOT_YET,
    bundled_until_ns,
    stop_of,
)
from dispatcher_daemon.fleet.tracking.orders import OrderBook
from dispatcher_daemon.fleet.tracking.situation import (
    HIDDEN,
    IDLE,
    FleetSituation,
    idle_text,
)
from dispatcher_daemon.fleet.tracking.tracker import FleetTracker
from dispatcher_daemon.fleet.tracking.vehicle import FRESH_NS, TrackedVehicle

__all__ = [
    "FRESH_NS",
    "HIDDEN",
    "IDLE",
    "NOT_YET",
    "NO_PLACE",
    "Claim",
    "FleetSituation",
    "FleetTracker",
    "OpenTour",
    "OrderBook",
    "TrackedVehicle",
    "at_risk",
    "bundled_until_ns",
    "fleet_of",
    "idle_text",
    "lateness",
    "lateness_s",
    "stop_of",
]

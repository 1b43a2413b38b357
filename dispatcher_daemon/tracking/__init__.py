"""The fleet as the dispatcher knows it: orders, plans and vehicles by their messages.

Nothing here reads a clock, the bus or the database: the daemon and the simulation use it alike.
"""

from __future__ import annotations

from dispatcher_daemon.tracking.lateness import lateness_s
from dispatcher_daemon.tracking.open_tours import OpenTour, fleet_of
from dispatcher_daemon.tracking.order_stops import NO_PLACE, OPENS_LATER, stop_of
from dispatcher_daemon.tracking.orders import OrderBook
from dispatcher_daemon.tracking.situation import HIDDEN, Situation
from dispatcher_daemon.tracking.tracker import FleetTracker
from dispatcher_daemon.tracking.vehicle import TrackedVehicle

__all__ = [
    "HIDDEN",
    "NO_PLACE",
    "OPENS_LATER",
    "FleetTracker",
    "OpenTour",
    "OrderBook",
    "Situation",
    "TrackedVehicle",
    "fleet_of",
    "lateness_s",
    "stop_of",
]

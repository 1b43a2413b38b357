"""The fleet as the dispatcher knows it: orders, plans and vehicles by their messages.

Nothing here reads a clock, the bus or the database: the daemon and the simulation use it alike.
"""

from __future__ import annotations

from dispatcher_daemon.tracking.situation import Situation
from dispatcher_daemon.tracking.tracker import FleetTracker
from dispatcher_daemon.tracking.vehicle import TrackedVehicle

__all__ = ["FleetTracker", "Situation", "TrackedVehicle"]

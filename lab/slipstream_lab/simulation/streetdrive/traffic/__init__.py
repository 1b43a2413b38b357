"""The road, and the trajectories of StreetDrive's scenarios on it."""

from slipstream_lab.simulation.streetdrive.traffic.road import Road, VehicleTrack
from slipstream_lab.simulation.streetdrive.traffic.scenarios import SCENARIOS, simulate

__all__ = ["SCENARIOS", "Road", "VehicleTrack", "simulate"]

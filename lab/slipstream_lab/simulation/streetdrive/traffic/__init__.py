"""The road, and the trajectories of StreetDrive's scenarios on it."""

from slipstream_lab.simulation.streetdrive.traffic.road import Road, Track
from slipstream_lab.simulation.streetdrive.traffic.scenarios import SCENARIOS, simulate

__all__ = ["SCENARIOS", "Road", "Track", "simulate"]

"""The road, and the trajectories of StreetDrive's scenarios on it."""

from simulation.streetdrive.traffic.road import Road, Track
from simulation.streetdrive.traffic.scenarios import SCENARIOS, simulate

__all__ = ["SCENARIOS", "Road", "Track", "simulate"]

"""Platooning of one vehicle: catch up, join, keep a close gap where gates are open, leave."""

from vehicle_agent.platooning.controller import Platooning
from vehicle_agent.platooning.gap_control import CLOSE_GAP_M, MIN_SPEED_MPS
from vehicle_agent.platooning.interface import Gates, PlatoonStep

__all__ = [
    "CLOSE_GAP_M",
    "MIN_SPEED_MPS",
    "Gates",
    "PlatoonStep",
    "Platooning",
]

"""Platooning of one vehicle: catch up, join, keep a close gap where gates are open, leave."""

from vehicle_agent.platooning.controller import Platooning
from vehicle_agent.platooning.gap_control import COMFORTABLE_MPS2, MIN_SPEED_MPS
from vehicle_agent.platooning.interface import Gates, PlatoonStep
from vehicle_agent.platooning.situation import OwnVehicle
from vehicle_agent.platooning.speed_commands import DELAY_S

__all__ = [
    "COMFORTABLE_MPS2",
    "DELAY_S",
    "MIN_SPEED_MPS",
    "Gates",
    "OwnVehicle",
    "PlatoonStep",
    "Platooning",
]

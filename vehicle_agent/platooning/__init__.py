"""Platooning of one vehicle: catch up, join, keep a close gap where gates are open, leave."""

from vehicle_agent.platooning.controller import Platooning
from vehicle_agent.platooning.gap_control import COMFORTABLE_MPS2, IDM, MIN_SPEED_MPS, Own
from vehicle_agent.platooning.interface import Gates, PlatoonStep
from vehicle_agent.platooning.needed_braking import AIM_M, AheadMotion, needed_mps2
from vehicle_agent.platooning.situation import OwnVehicle
from vehicle_agent.platooning.speed_commands import DELAY_S

__all__ = [
    "AIM_M",
    "COMFORTABLE_MPS2",
    "DELAY_S",
    "IDM",
    "MIN_SPEED_MPS",
    "AheadMotion",
    "Gates",
    "Own",
    "OwnVehicle",
    "PlatoonStep",
    "Platooning",
    "needed_mps2",
]

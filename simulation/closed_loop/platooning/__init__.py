"""Platoons on the road: who drives close behind whom, how they come together and how they part."""

from simulation.closed_loop.platooning.platooning import Platooning
from simulation.closed_loop.platooning.step import PlatoonStep

__all__ = ["PlatoonStep", "Platooning"]

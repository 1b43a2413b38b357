"""Platooning on the road: catch up, join, keep a close gap, leave."""

from simulation.controllers.platooning.controller import Platooning

__all__ = ["Platooning"]

"""Speed advice: coasting towards turns and stops, and reaching signals when they are green."""

from simulation.controllers.advice.advisor import SpeedAdvisor
from simulation.controllers.advice.road import Roads, read_roads

__all__ = ["Roads", "SpeedAdvisor", "read_roads"]

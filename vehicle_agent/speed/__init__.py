"""Speed advice: coasting towards turns and stops, reaching signals at green, and its ceiling."""

from vehicle_agent.speed.advisor import SpeedAdvisor
from vehicle_agent.speed.envelope import HARD_MPS2, Ceiling, ceiling

__all__ = ["HARD_MPS2", "Ceiling", "SpeedAdvisor", "ceiling"]

"""Speed advice: coasting towards turns and stops, reaching signals at green, and its ceiling."""

from vehicle_agent.speed.advisor import SpeedAdvisor
from vehicle_agent.speed.envelope import Ceiling, ceiling

__all__ = ["Ceiling", "SpeedAdvisor", "ceiling"]

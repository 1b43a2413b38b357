"""What movements cost, learned from drives: passages counted, sums by hour, and expectations."""

from __future__ import annotations

from dispatcher_daemon.fleet.learning.costs import MovementCosts
from dispatcher_daemon.fleet.learning.history import HOUR_NS, HOURS, History
from dispatcher_daemon.fleet.learning.learning import Learned, Learning
from dispatcher_daemon.fleet.learning.passages import DrivenTrace, Passages
from dispatcher_daemon.fleet.learning.usual_traffic import UsualTraffic

__all__ = [
    "HOURS",
    "HOUR_NS",
    "DrivenTrace",
    "History",
    "Learned",
    "Learning",
    "MovementCosts",
    "Passages",
    "UsualTraffic",
]

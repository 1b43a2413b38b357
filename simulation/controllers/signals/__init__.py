"""Signals and the fleet: broadcast signal timing, signal priority, and the departure second."""

from simulation.controllers.signals.departure import DepartureOptimizer, DepartureSettings
from simulation.controllers.signals.priority import Priority
from simulation.controllers.signals.timing import Signals

__all__ = ["DepartureOptimizer", "DepartureSettings", "Priority", "Signals"]

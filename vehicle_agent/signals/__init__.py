"""Signals as a vehicle meets them: their timing, requests for green, and the departure second."""

from vehicle_agent.signals.departure import DepartureOptimizer, DepartureSettings
from vehicle_agent.signals.requests import SignalRequests
from vehicle_agent.signals.timings import (
    HORIZON_M,
    Green,
    Indication,
    SignalTimings,
    intersections_ahead,
)

__all__ = [
    "HORIZON_M",
    "DepartureOptimizer",
    "DepartureSettings",
    "Green",
    "Indication",
    "SignalRequests",
    "SignalTimings",
    "intersections_ahead",
]

"""Signals as a vehicle meets them: their timing, requests for green, and the departure second."""

from vehicle_agent.signals.departure import DEPARTURE_WINDOW_S, LegDeparture
from vehicle_agent.signals.requests import SignalRequests
from vehicle_agent.signals.timings import (
    HORIZON_M,
    Green,
    Indication,
    SignalTimings,
    intersections_ahead,
)

__all__ = [
    "DEPARTURE_WINDOW_S",
    "HORIZON_M",
    "Green",
    "Indication",
    "LegDeparture",
    "SignalRequests",
    "SignalTimings",
    "intersections_ahead",
]

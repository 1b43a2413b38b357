"""Traffic: segment states of RSUs, how they are received, and what of them opens a gate."""

from __future__ import annotations

from dispatcher_daemon.traffic.reception import MAX_RSUS, Reception
from dispatcher_daemon.traffic.snapshot import (
    MIN_SPEED_MPS,
    Expectations,
    GateForecast,
    Movement,
    SegmentTraffic,
    TrafficSnapshot,
    judge,
    planning_speed_mps,
    take_snapshot,
    traffic_by,
)
from dispatcher_daemon.traffic.states import HARMLESS, LatestStates, Verdict

__all__ = [
    "HARMLESS",
    "MAX_RSUS",
    "MIN_SPEED_MPS",
    "Expectations",
    "GateForecast",
    "LatestStates",
    "Movement",
    "Reception",
    "SegmentTraffic",
    "TrafficSnapshot",
    "Verdict",
    "judge",
    "planning_speed_mps",
    "take_snapshot",
    "traffic_by",
]

"""Costs of segments and turns, least-energy paths between the fleet's places, and timetables."""

from __future__ import annotations

from dispatcher_daemon.roads.costs import segment_cost_kwh
from dispatcher_daemon.roads.onward import leg_from, leg_onward, unhindered_s
from dispatcher_daemon.roads.routes import (
    Leg,
    Route,
    RoutedArc,
    candidate_arcs,
    lateness_s,
    timed,
    timetable,
)
from dispatcher_daemon.roads.travel import Roads, Travel, least_energy_legs, roads_of

__all__ = [
    "Leg",
    "Roads",
    "Route",
    "RoutedArc",
    "Travel",
    "candidate_arcs",
    "lateness_s",
    "least_energy_legs",
    "leg_from",
    "leg_onward",
    "roads_of",
    "segment_cost_kwh",
    "timed",
    "timetable",
    "unhindered_s",
]

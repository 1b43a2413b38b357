"""Costs of segments and turns, least-energy paths between the fleet's places, and timetables."""

from __future__ import annotations

from dispatcher_daemon.planning.roads.arrays import Roads, roads_of
from dispatcher_daemon.planning.roads.costs import held_cost_kwh, planning_speed_mps
from dispatcher_daemon.planning.roads.given import given_matrices
from dispatcher_daemon.planning.roads.onward import leg_from, leg_onward, unhindered_s
from dispatcher_daemon.planning.roads.routes import (
    RoadLeg,
    Route,
    RoutedArc,
    candidate_arcs,
    empty_leg,
    lateness_by_window_s,
    lateness_s,
    timed,
    timetable,
)
from dispatcher_daemon.planning.roads.travel import (
    Travel,
    fleet_travel,
    least_energy_legs,
    leg_along,
    searched_again,
)
from dispatcher_daemon.planning.roads.ways import Ways
from dispatcher_daemon.planning.roads.weights import Floats

__all__ = [
    "Floats",
    "RoadLeg",
    "Roads",
    "Route",
    "RoutedArc",
    "Travel",
    "Ways",
    "candidate_arcs",
    "empty_leg",
    "fleet_travel",
    "given_matrices",
    "held_cost_kwh",
    "lateness_by_window_s",
    "lateness_s",
    "least_energy_legs",
    "leg_along",
    "leg_from",
    "leg_onward",
    "planning_speed_mps",
    "roads_of",
    "searched_again",
    "timed",
    "timetable",
    "unhindered_s",
]

"""Routes and departures: base routes without platooning (PyVRP), options of each vehicle, blocks of
vehicles for the solvers, and sweeps over the blocks (block-coordinate descent)."""

from __future__ import annotations

from dispatcher_daemon.planning.cycle import route_cycle
from dispatcher_daemon.planning.fleet_plan import (
    NO_VEHICLE,
    FleetPlan,
    initial_plans,
    plan_fleet,
)
from dispatcher_daemon.planning.form import RouteForm, route_form
from dispatcher_daemon.planning.insertion import Insertion, insert_stops
from dispatcher_daemon.planning.itineraries import Planner
from dispatcher_daemon.planning.options import add_discounted_ways
from dispatcher_daemon.planning.pyvrp_search import Searched, search_within
from dispatcher_daemon.planning.refused import refused_platoons
from dispatcher_daemon.planning.servability import (
    NO_WAY,
    WINDOW_CLOSES,
    servable_part,
    unservable,
)
from dispatcher_daemon.planning.sweeps import Choice, choice_of, scheduled

__all__ = [
    "NO_VEHICLE",
    "NO_WAY",
    "WINDOW_CLOSES",
    "Choice",
    "FleetPlan",
    "Insertion",
    "Planner",
    "RouteForm",
    "Searched",
    "add_discounted_ways",
    "choice_of",
    "initial_plans",
    "insert_stops",
    "plan_fleet",
    "refused_platoons",
    "route_cycle",
    "route_form",
    "scheduled",
    "search_within",
    "servable_part",
    "unservable",
]

"""Routes and departures: base routes without platooning (PyVRP), options of each vehicle, blocks of
vehicles for the solvers, and sweeps over the blocks (block-coordinate descent)."""

from __future__ import annotations

from dispatcher_daemon.planning.improvement.options import add_discounted_ways
from dispatcher_daemon.planning.improvement.refused import refused_platoons
from dispatcher_daemon.planning.improvement.sweeps import Choice, choice_of, scheduled
from dispatcher_daemon.planning.route_form.cycle import route_cycle
from dispatcher_daemon.planning.route_form.fleet_plan import (
    NO_VEHICLE,
    FleetPlan,
    initial_plans,
    plan_fleet,
)
from dispatcher_daemon.planning.route_form.form import RouteForm, route_form
from dispatcher_daemon.planning.routes.insertion import Insertion, insert_stops
from dispatcher_daemon.planning.routes.itineraries import Planner
from dispatcher_daemon.planning.routes.pyvrp_search import Searched, search_within
from dispatcher_daemon.planning.routes.servability import (
    NO_WAY,
    WINDOW_CLOSES,
    servable_part,
    unservable,
)

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

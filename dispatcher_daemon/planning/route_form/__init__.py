"""The cycle in route form: a plan of the fleet from base routes and sweeps."""

from __future__ import annotations

from dispatcher_daemon.planning.route_form.cycle import route_cycle
from dispatcher_daemon.planning.route_form.fleet_plan import (
    NO_VEHICLE,
    FleetPlan,
    initial_plans,
    plan_fleet,
)
from dispatcher_daemon.planning.route_form.form import RouteForm, route_form

__all__ = [
    "NO_VEHICLE",
    "FleetPlan",
    "RouteForm",
    "initial_plans",
    "plan_fleet",
    "route_cycle",
    "route_form",
]

"""The cycle in route form: a plan of the fleet from base routes and sweeps."""

from __future__ import annotations

from dispatcher_daemon.planning.route_form.cycle import BASE, route_cycle
from dispatcher_daemon.planning.route_form.fleet_plan import (
    NO_ROOM,
    NO_VEHICLE,
    FleetPlan,
    InitialPlans,
    first_routes,
    initial_plans,
    plan_fleet,
    servable,
    with_ways,
)

__all__ = [
    "BASE",
    "NO_ROOM",
    "NO_VEHICLE",
    "FleetPlan",
    "InitialPlans",
    "first_routes",
    "initial_plans",
    "plan_fleet",
    "route_cycle",
    "servable",
    "with_ways",
]

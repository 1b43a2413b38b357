"""Demand of a day from a seed: background trips and routes, breakdowns, and deliveries."""

from slipstream_lab.simulation.scenarios.demand.breakdowns import DrawnBreakdown, draw_breakdowns
from slipstream_lab.simulation.scenarios.demand.deliveries import (
    Deliveries,
    FleetSettings,
    Order,
    busiest_begin_s,
    draw_deliveries,
    fleet_at,
)
from slipstream_lab.simulation.scenarios.demand.route_file import write_routes
from slipstream_lab.simulation.scenarios.demand.routes import Routes, find_routes
from slipstream_lab.simulation.scenarios.demand.trips import (
    DAY_S,
    Array,
    DemandSettings,
    Flow,
    Indices,
    Trips,
    Zone,
    departures,
    draw_trips,
    gateways,
    zone_weights,
)

__all__ = [
    "DAY_S",
    "Array",
    "Deliveries",
    "DemandSettings",
    "DrawnBreakdown",
    "FleetSettings",
    "Flow",
    "Indices",
    "Order",
    "Routes",
    "Trips",
    "Zone",
    "busiest_begin_s",
    "departures",
    "draw_breakdowns",
    "draw_deliveries",
    "draw_trips",
    "find_routes",
    "fleet_at",
    "gateways",
    "write_routes",
    "zone_weights",
]

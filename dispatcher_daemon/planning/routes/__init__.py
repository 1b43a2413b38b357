"""Routes without platooning: order of stops, ways, breaks, charging (PyVRP)."""

from __future__ import annotations

from dispatcher_daemon.planning.routes.base_routes import base_routes
from dispatcher_daemon.planning.routes.insertion import Insertion, insert_stops
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.planning.routes.pyvrp_model import NO_PATH_MWH, VrpModel
from dispatcher_daemon.planning.routes.pyvrp_search import (
    HIGH_PENALTIES,
    Searched,
    search_parameters,
    search_within,
)
from dispatcher_daemon.planning.routes.servability import (
    NO_WAY,
    WINDOW_CLOSES,
    obstacles,
    servable_part,
    unservable,
)

__all__ = [
    "HIGH_PENALTIES",
    "NO_PATH_MWH",
    "NO_WAY",
    "WINDOW_CLOSES",
    "Insertion",
    "Itinerary",
    "Planner",
    "Searched",
    "VrpModel",
    "base_routes",
    "insert_stops",
    "obstacles",
    "search_parameters",
    "search_within",
    "servable_part",
    "unservable",
]

"""Requests and responses in VROOM's format: read, solved with PyVRP, timed, answered."""

from __future__ import annotations

from dispatcher_daemon.service.vroom.engine import RoutingEngine
from dispatcher_daemon.service.vroom.service import (
    INPUT_ERROR,
    INTERNAL_ERROR,
    ROUTING_ERROR,
    solve_vroom,
)

__all__ = ["INPUT_ERROR", "INTERNAL_ERROR", "ROUTING_ERROR", "RoutingEngine", "solve_vroom"]

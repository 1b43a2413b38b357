"""Routes of a request: a search by PyVRP, then all rules exactly."""

from __future__ import annotations

from dispatcher_daemon.service.vroom.routes.repair import repaired, units_of, unservable
from dispatcher_daemon.service.vroom.routes.search import search

__all__ = ["repaired", "search", "units_of", "unservable"]

"""Fixtures of the dispatcher's tests that the laboratory's tests share."""

from __future__ import annotations

from tests.dispatcher_daemon.conftest import (
    demo,
    demo_arcs,
    now_ns,
    random_arcs,
    random_routes,
    state,
    town,
    traffic,
)

__all__ = [
    "demo",
    "demo_arcs",
    "now_ns",
    "random_arcs",
    "random_routes",
    "state",
    "town",
    "traffic",
]

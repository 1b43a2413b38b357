"""What a search for routes needs to know of ways between places."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from dispatcher_daemon.fleet import Vehicle
from dispatcher_daemon.planning.roads.routes import RoadLeg
from dispatcher_daemon.planning.roads.weights import Floats
from slipstream.vehicle_types import RoutingProfile


class Ways(Protocol):
    """Costs and times of ways: over roads (`Travel`), or as matrices give them."""

    @property
    def row(self) -> Mapping[str, int]:
        """Row and column of each place in the matrices."""

    @property
    def search_cost_kwh(self) -> Floats:
        """What the search minimises, inf where there is no way, shape (n, n)."""

    @property
    def duration_s(self) -> Floats:
        """Time of the same ways, shape (n, n)."""

    @property
    def by_profile(self) -> Mapping[RoutingProfile, Ways]:
        """The ways of vehicles of each profile."""

    def of(self, vehicle: Vehicle) -> Ways:
        """The ways of a vehicle's profile."""

    def leg(self, start: str, end: str) -> RoadLeg | None:
        """The way between two places; None if there is none. Asked where a battery limits it."""

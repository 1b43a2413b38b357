"""Freight trips on a road network: what every strategy of coordination is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

MS: int = 1000
"""Milliseconds a second. Times are whole milliseconds, so that vehicles meet exactly."""


@dataclass(frozen=True)
class FreightSegment:
    """One segment as a planner sees it.

    Attributes:
        duration_ms: time to drive it at the planning speed, > 0.
        stop_kwh: energy of a stop at its begin, where vehicles may wait for others; None: they may
            not.
    """

    length_m: float
    duration_ms: int
    follower_kwh: float
    leader_kwh: float
    is_open: bool = True
    stop_kwh: float | None = None


@dataclass(frozen=True)
class Trip:
    """One vehicle's drive. `ready_ms`: earliest departure, since midnight; below 0: the day
    before.
    """

    id: str
    carrier: str
    path: tuple[str, ...]
    ready_ms: int
    latest_ms: int


@dataclass(frozen=True)
class Freight:
    """All trips of a day with the roads that they take."""

    name: str
    segments: Mapping[str, FreightSegment]
    trips: tuple[Trip, ...]

    def alone_ms(self, trip: Trip) -> int:
        """Driving time of a trip."""
        return sum(self.segments[name].duration_ms for name in trip.path)

    def slack_ms(self, trip: Trip) -> int:
        """Longest time that a trip may wait in all."""
        return trip.latest_ms - trip.ready_ms - self.alone_ms(trip)

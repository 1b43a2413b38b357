"""Freight trips on a road network: what every strategy of coordination is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from slipstream.errors import InputError

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
    """One vehicle's drive.

    Attributes:
        ready_ms: earliest departure, since midnight; below 0: the day before.
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

    def __post_init__(self) -> None:
        """Check that the trips can be driven.

        Raises:
            InputError: no trip, an unknown segment, no open one on the way, or a window in which
                nobody can arrive.
        """
        if not self.trips:
            raise InputError(self.name, "no trip", "give at least one")
        for trip in self.trips:
            strange = next((name for name in trip.path if name not in self.segments), None)
            if strange is not None:
                problem, mend = f"no segment {strange!r}", "name one of the network"
            elif not any(self.segments[name].is_open for name in trip.path):
                problem, mend = "no open segment on the way", "leave the trip out"
            elif self.slack_ms(trip) < 0:
                problem, mend = "it arrives too late without a wait", "give a later latest_ms"
            else:
                continue
            raise InputError(self.name, problem, mend, key=trip.id)

    def alone_ms(self, trip: Trip) -> int:
        """Driving time of a trip."""
        return sum(self.segments[name].duration_ms for name in trip.path)

    def slack_ms(self, trip: Trip) -> int:
        """Longest time that a trip may wait in all."""
        return trip.latest_ms - trip.ready_ms - self.alone_ms(trip)

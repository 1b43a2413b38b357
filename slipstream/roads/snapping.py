"""The road nearest to a place, and where vehicles stop for that place."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from slipstream.roads.network import RoadNetwork, Segment
from slipstream.vehicle_types import RoutingProfile

MAX_SNAP_M: Final = 200.0
"""From a place to its road; one further away is refused."""
_BESIDE_EXPRESSWAY_M: Final = 200.0
"""A junction that an expressway, a ramp or a tunnel touches counts as so much further away: there a
vehicle would stop in fast traffic, and elsewhere it is so much further from the address."""
_INVENTED: Final = ("-AddedOnRampNode", "-AddedOffRampNode")
"""Endings of the nodes that netconvert adds where lanes begin or end beside a ramp."""
NO_CLASSES: Final = (
    "the net tells no road classes: roads of 90 km/h and more count as expressways, where no "
    "address is served"
)


class NoPlaceError(ValueError):
    """A place that no vehicle can stop for: what is wrong, and what mends it."""

    def __init__(self, problem: str, mend: str) -> None:
        self.problem, self.mend = problem, mend
        super().__init__(f"{problem}; {mend}")


@dataclass(frozen=True)
class Snapped:
    """A place on a road.

    Attributes:
        segment: the road.
        node: its end where vehicles stop for the place.
        distance_m: from the place to the road.
        to_node_m: from the place to that end.
    """

    segment: str
    node: str
    distance_m: float
    to_node_m: float


class Snapper:
    """Finds roads of a network near places, for vehicles of some profiles."""

    def __init__(
        self,
        network: RoadNetwork,
        profiles: Iterable[RoutingProfile],
        *,
        for_stops: bool = True,
    ) -> None:
        """Collect the roads that vehicles of at least one profile may use.

        Args:
            for_stops: only those where addresses are served (`Segment.allows_stops`).
        """
        self._network = network
        self._profiles = tuple(profiles)
        self._for_stops = for_stops
        roads = [
            segment
            for segment in network.segments.values()
            if (not for_stops or (segment.allows_stops and self._ends(segment)))
            and any(segment.access.admits(profile) for profile in self._profiles)
        ]
        owners, begins, ends = [], [], []
        for segment in roads:
            for begin, end in zip(segment.shape, segment.shape[1:], strict=False):
                owners.append(segment.id)
                begins.append(begin)
                ends.append(end)
        self._owners = owners
        self._begins = np.array(begins, dtype=np.float64).reshape(-1, 2)
        self._along = np.array(ends, dtype=np.float64).reshape(-1, 2) - self._begins

    def stop_for(self, latitude: float, longitude: float) -> Snapped:
        """Where vehicles stop for a place in degrees (WGS 84): at an end of the nearest road.

        Raises:
            NoPlaceError: the network has no projection, the place is none of it, or it is more than
                `MAX_SNAP_M` from each road where these vehicles may stop.
        """
        projection, mend = self._network.projection, "name a junction as node"
        if projection is None:
            problem = f"network {self._network.name!r} knows no latitude and longitude"
            raise NoPlaceError(problem, mend)
        try:
            place_m = projection.place_m(latitude, longitude)
        except ValueError as error:
            raise NoPlaceError(str(error), mend) from None
        found = self.nearest(place_m)
        if found is not None and found.distance_m <= MAX_SNAP_M:
            return found
        any_road = self._every_road.nearest(place_m)
        if any_road is None:
            raise NoPlaceError("no road that its vehicles may use", "check the vehicles' types")
        if any_road.distance_m <= MAX_SNAP_M:
            problem = (
                f"on its roads within {MAX_SNAP_M:.0f} m no address is served "
                f"({any_road.segment!r} is {self._why(any_road.segment)})"
            )
            raise NoPlaceError(problem, f"{mend}, or give a place beside another road")
        problem = f"{any_road.distance_m:.0f} m from the nearest road that its vehicles may use"
        raise NoPlaceError(problem, f"give a place within {MAX_SNAP_M:.0f} m of one")

    def nearest(self, place_m: tuple[float, float]) -> Snapped | None:
        """The nearest road; None: there is none that these vehicles may use."""
        return next(iter(self.near(place_m, 1)), None)

    def near(self, place_m: tuple[float, float], count: int) -> tuple[Snapped, ...]:
        """The nearest roads that these vehicles may use, at most ``count``, the nearest first."""
        if not self._owners:
            return ()
        place = np.array(place_m)
        length2 = np.maximum((self._along**2).sum(axis=1), 1e-12)
        share = ((place - self._begins) * self._along).sum(axis=1) / length2
        points = self._begins + np.clip(share, 0.0, 1.0)[:, None] * self._along
        distances = np.hypot(*(points - place).T)
        order = [int(distances.argmin())] if count == 1 else np.argsort(distances, kind="stable")
        found: dict[str, float] = {}
        for at in order:
            found.setdefault(self._owners[at], float(distances[at]))
            if len(found) == count:
                break
        return tuple(self._snapped(name, place_m, distance) for name, distance in found.items())

    def _snapped(self, name: str, place_m: tuple[float, float], distance_m: float) -> Snapped:
        """A road with the end where vehicles stop for a place."""
        junctions = self._network.junctions

        def away_m(end: str) -> float:
            return math.dist(junctions[end], place_m)

        def cost_m(end: str) -> float:
            return away_m(end) + _BESIDE_EXPRESSWAY_M * (end in self._beside_expressways)

        segment = self._network.segments[name]
        ends = self._ends(segment) if self._for_stops else (segment.end, segment.start)
        node = min(ends, key=cost_m if self._for_stops else away_m)
        return Snapped(name, node, distance_m, away_m(node))

    def _ends(self, segment: Segment) -> tuple[str, ...]:
        """The ends of a road that are junctions, not made up by netconvert."""
        return tuple(end for end in (segment.end, segment.start) if not end.endswith(_INVENTED))

    @cached_property
    def _every_road(self) -> Snapper:
        return Snapper(self._network, self._profiles, for_stops=False)

    def _why(self, name: str) -> str:
        segment = self._network.segments[name]
        if segment.in_tunnel:
            return "in a tunnel"
        if segment.road_class:
            return f"a {segment.road_class}"
        return f"of no known class, {segment.speed_limit_mps * 3.6:.0f} km/h"

    @cached_property
    def _beside_expressways(self) -> frozenset[str]:
        return _ends_of(s for s in self._network.segments.values() if not s.allows_stops)


def stopping_junctions(network: RoadNetwork) -> tuple[str, ...]:
    """Junctions where a vehicle may stop, sorted: those that no expressway, ramp or tunnel touches;
    where a network has none, all.
    """
    fast = _ends_of(s for s in network.segments.values() if not s.allows_stops)
    every = _ends_of(network.segments.values())
    found = {end for end in every - fast if not end.endswith(_INVENTED)}
    return tuple(sorted(found or every))


def _ends_of(segments: Iterable[Segment]) -> frozenset[str]:
    return frozenset(end for segment in segments for end in (segment.start, segment.end))


def lacks_classes(network: RoadNetwork) -> bool:
    """Whether a limit alone says of some road of a network that no address is served there."""
    return any(
        not (s.allows_stops or s.road_class or s.in_tunnel) for s in network.segments.values()
    )

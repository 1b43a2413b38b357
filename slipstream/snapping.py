"""The road nearest to a place, among those that some vehicles may use."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from slipstream.roads import RoadNetwork
from slipstream.vehicle_types import RoutingProfile


@dataclass(frozen=True)
class Snapped:
    """A place on a road.

    Attributes:
        segment: the road.
        node: its end that is nearer to the place, where vehicles stop for it.
        distance_m: from the place to the road.
    """

    segment: str
    node: str
    distance_m: float


class Snapper:
    """Finds the nearest road of a network, for vehicles of some profiles."""

    def __init__(self, network: RoadNetwork, profiles: Iterable[RoutingProfile]) -> None:
        """Collect the roads that vehicles of at least one profile may use."""
        self._network = network
        wanted = list(profiles)
        owners, begins, ends = [], [], []
        for segment in network.segments.values():
            if any(segment.access.admits(profile) for profile in wanted):
                for begin, end in zip(segment.shape, segment.shape[1:], strict=False):
                    owners.append(segment.id)
                    begins.append(begin)
                    ends.append(end)
        self._owners = owners
        self._begins = np.array(begins, dtype=np.float64).reshape(-1, 2)
        self._along = np.array(ends, dtype=np.float64).reshape(-1, 2) - self._begins

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
        return tuple(
            Snapped(name, self._end(name, place_m), distance) for name, distance in found.items()
        )

    def _end(self, name: str, place_m: tuple[float, float]) -> str:
        """The end of a road that is nearer to a place."""
        segment, junctions = self._network.segments[name], self._network.junctions
        ends = (segment.end, segment.start)
        return min(ends, key=lambda end: math.dist(junctions[end], place_m))

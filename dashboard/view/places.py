"""Where segments and vehicles lie in the plane of the network; pure."""

from __future__ import annotations

import math
from bisect import bisect_right
from functools import lru_cache
from itertools import accumulate, pairwise

from slipstream.roads import RoadNetwork

Place = tuple[float, float, float]
"""x and y, m, and the heading, degrees clockwise from north."""
_MIDDLES = 10_000
"""Sets of segments, as those of RSUs, whose middle is kept."""


class Places:
    """The places of one network."""

    def __init__(self, network: RoadNetwork) -> None:
        self.network = network
        self.index = {name: number for number, name in enumerate(network.segments)}
        self._line = lru_cache(maxsize=len(self.index) + 1)(self._measured)
        self.middle = lru_cache(maxsize=_MIDDLES)(self._middle)
        """The middle of several segments, m; None of unknown ones. It takes a tuple of them."""

    def on_road(self, segment: str, share: float) -> Place | None:
        """The place at a share of a segment, 0 to 1; None on an unknown one."""
        if segment not in self.index:
            return None
        shape, begins, length = self._line(segment)
        along = min(max(share, 0.0), 1.0) * length
        part = min(max(bisect_right(begins, along) - 1, 0), len(shape) - 2)
        (x0, y0), (x1, y1) = shape[part], shape[part + 1]
        whole = begins[part + 1] - begins[part]
        rest = (along - begins[part]) / whole if whole else 0.0
        heading = math.degrees(math.atan2(x1 - x0, y1 - y0)) % 360.0
        return x0 + rest * (x1 - x0), y0 + rest * (y1 - y0), heading

    def at_node(self, node: str) -> tuple[float, float] | None:
        """The place of a junction, m; None of an unknown one."""
        return self.network.junctions.get(node)

    def _middle(self, segments: tuple[str, ...]) -> tuple[float, float] | None:
        places = [self.on_road(segment, 0.5) for segment in segments]
        known = [place for place in places if place is not None]
        if not known:
            return None
        return sum(x for x, _, _ in known) / len(known), sum(y for _, y, _ in known) / len(known)

    def _measured(self, segment: str) -> tuple[tuple[tuple[float, float], ...], list[float], float]:
        """Points of a segment, how far along it each one lies, and the whole length, m."""
        shape = self.network.segments[segment].shape
        begins = list(accumulate((math.dist(a, b) for a, b in pairwise(shape)), initial=0.0))
        return shape, begins, begins[-1]

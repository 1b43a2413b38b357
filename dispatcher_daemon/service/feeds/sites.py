"""Measurement sites: each road segment that an RSU watches, by latitude and longitude; and times as
both feeds write them.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from itertools import pairwise
from typing import Final

from slipstream.errors import InputError
from slipstream.messages import RsuHealth, SegmentState
from slipstream.messages.base import chunk
from slipstream.roads import RoadNetwork

Pair = tuple[str, str]
"""An RSU and a segment."""
MAX_RSUS_PER_SEGMENT: Final = 16
"""Unlisted RSUs whose health tells of the same segment: as many as their states are kept of."""
_DEGREES: Final = ".7f"
"""1 cm on the ground."""


@dataclass(frozen=True)
class Site:
    """One road segment as one RSU measures it.

    Attributes:
        lanes: its number of lanes; states cover all of them.
        line: its centre line in driving direction, latitude and longitude in degrees (WGS 84),
            written as both feeds show them; at least two points.
    """

    rsu: str
    segment: str
    lanes: int
    line: tuple[tuple[str, str], ...]
    middle: tuple[str, str]

    @property
    def id(self) -> str:
        """Unique among all sites, in ASCII, whatever the two names are."""
        return f"{chunk(self.rsu)}/{chunk(self.segment)}"

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.rsu}: {self.segment}"

    @cached_property
    def version(self) -> str:
        """Changes when what is told of the site changes, and only then."""
        return digest(repr((self.rsu, self.segment, self.lanes, self.line)))


def digest(text: str) -> str:
    """A short name of a content: ten hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:10]


def watched_pairs(
    rsus: Mapping[str, tuple[str, ...]] | None,
    states: Iterable[SegmentState],
    healths: Iterable[RsuHealth],
) -> frozenset[Pair]:
    """The segments that RSUs watch: those listed, or, where none are, those they told of."""
    if rsus is not None:
        return frozenset((rsu, segment) for rsu, segments in rsus.items() for segment in segments)
    told: dict[str, set[str]] = {}
    for health in sorted(healths, key=lambda health: health.rsu):
        for segment in health.segments:
            known = told.setdefault(segment, set())
            if len(known) < MAX_RSUS_PER_SEGMENT:
                known.add(health.rsu)
    heard = {(state.rsu, state.segment) for state in states}
    return frozenset(heard | {(rsu, segment) for segment, some in told.items() for rsu in some})


def find_sites(network: RoadNetwork, pairs: Iterable[Pair]) -> tuple[Site, ...]:
    """The sites of RSUs and segments, ordered by RSU and segment.

    Segments that the network has not are left out.

    Raises:
        InputError: the network has no latitude and longitude, or not for all of its places.
    """
    if network.projection is None:
        raise InputError(
            network.name,
            "this network knows no latitude and longitude, which feeds need",
            "build it from a map with netconvert --proj.utm",
        )
    lines: dict[str, tuple[tuple[str, str], ...]] = {}
    found = []
    for rsu, name in sorted(set(pairs)):
        segment = network.segments.get(name)
        if segment is None:
            continue
        if name not in lines:
            try:
                points = network.projection.degrees([*segment.shape, _half_way(segment.shape)])
            except ValueError as error:
                mend = "check the projection in its <location>"
                raise InputError(network.name, str(error), mend, key=name) from None
            lines[name] = tuple(
                (format(latitude, _DEGREES), format(longitude, _DEGREES))
                for latitude, longitude in points
            )
        *line, middle = lines[name]
        found.append(Site(rsu, name, segment.lanes, tuple(line), middle))
    return tuple(found)


def _half_way(shape: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The point in the middle of a line, by length."""
    pieces = list(pairwise(shape))
    left = sum(math.dist(begin, end) for begin, end in pieces) / 2
    for begin, end in pieces:
        length = math.dist(begin, end)
        if 0 < left <= length:
            share = left / length
            return begin[0] + share * (end[0] - begin[0]), begin[1] + share * (end[1] - begin[1])
        left -= length
    return shape[-1]


def iso_time(time_ns: int) -> str:
    """RFC 3339 with milliseconds, cut off."""
    whole = datetime.fromtimestamp(time_ns // 10**9, UTC)
    return f"{whole:%Y-%m-%dT%H:%M:%S}.{time_ns % 10**9 // 10**6:03d}Z"


def window(time_ns: int, window_s: float) -> tuple[str, str]:
    """Begin and end of a window that ends at a time."""
    return iso_time(max(0, time_ns - round(window_s * 1e9))), iso_time(time_ns)

"""Where a vehicle was, by the positions that it has sent: at the places of its orders, and when it
was not heard.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from slipstream.messages import VehiclePosition
from slipstream.roads import RoadNetwork

AT_PLACE_M: Final = 100.0
"""A vehicle this near to a junction is there: at its depot, or at the place of an order."""
LEEWAY_NS: Final = 300 * 10**9
"""A driver may say so long after being there that something is served."""
EARLY_NS: Final = 60 * 10**9
"""So long before being there it may be said."""
SILENCE_NS: Final = 15 * 10**9
"""Between positions further apart than this, nobody knows where a vehicle was."""
MAX_MPS: Final = 60.0
"""No vehicle gets on faster than this in a straight line."""
_SLACK_M: Final = 2 * AT_PLACE_M
_MAX_STAYS, _MAX_SILENCES = 8, 64

Point = tuple[float, float]
Presence = Literal["there", "may_have_been", "not_known", "elsewhere"]
"""Whether a vehicle was at a place at a time. "may_have_been": it was not heard then, and could
have gone there and on to where it was heard next; "not_known": it has not been heard since."""


@dataclass(frozen=True)
class Sighting:
    """A vehicle at a place, by its own clock."""

    time_ns: int
    at: Point


@dataclass(frozen=True)
class _Silence:
    before: Sighting | None
    after: Sighting


def where(network: RoadNetwork, position: VehiclePosition) -> Point:
    """A position on the plane, as if its segment were straight."""
    segment, at = network.segments[position.segment], network.junctions
    (x0, y0), (x1, y1) = at[segment.start], at[segment.end]
    return x0 + position.share * (x1 - x0), y0 + position.share * (y1 - y0)


def is_at(network: RoadNetwork, position: VehiclePosition, node: str) -> bool:
    """Whether a position is at a junction, along its road or straight across."""
    segment = network.segments[position.segment]
    if segment.end == node and (1.0 - position.share) * segment.length_m <= AT_PLACE_M:
        return True
    if segment.start == node and position.share * segment.length_m <= AT_PLACE_M:
        return True
    place = network.junctions.get(node)
    return place is not None and math.dist(where(network, position), place) <= AT_PLACE_M


class VehicleSightings:
    """What is kept of one vehicle's positions, with times of its own clock, as of its visits."""

    def __init__(self, last: Sighting | None = None) -> None:
        self._last = last
        self._heard = False
        self._stays: dict[str, list[tuple[int, int]]] = {}
        self._silences: list[_Silence] = []

    def take(
        self, position: VehiclePosition, network: RoadNetwork, places: Mapping[str, str]
    ) -> None:
        """A position that is later than those before.

        Args:
            places: junctions of the orders that matter, by order; stays at others are forgotten.
        """
        now, last = Sighting(position.time_ns, where(network, position)), self._last
        since_ns = None if last is None else now.time_ns - last.time_ns
        if not self._heard or since_ns is None or not 0 <= since_ns <= SILENCE_NS:
            known = since_ns is not None and since_ns >= 0
            self._silences.append(_Silence(last if known else None, now))
            del self._silences[:-_MAX_SILENCES]
        self._heard, self._last = True, now
        for gone in self._stays.keys() - places.keys():
            del self._stays[gone]
        for order, node in places.items():
            if is_at(network, position, node):
                self._stay(order, now.time_ns)

    def _stay(self, order: str, time_ns: int) -> None:
        stays = self._stays.setdefault(order, [])
        if stays and 0 <= time_ns - stays[-1][1] <= SILENCE_NS:
            stays[-1] = stays[-1][0], time_ns
        else:
            stays.append((time_ns, time_ns))
            del stays[:-_MAX_STAYS]

    def presence(
        self, order: str, place: Point | None, since_ns: int, arrived_ns: int, ended_ns: int
    ) -> Presence:
        """Whether it was at the place of an order at some time of a visit, up to `LEEWAY_NS` before
        or `EARLY_NS` after.

        Args:
            order: one of those that `take` was given.
            place: its junction's; None: the network does not have it any more.
        """
        begin_ns, end_ns = max(since_ns, arrived_ns) - LEEWAY_NS, ended_ns + EARLY_NS
        if any(begin <= end_ns and begin_ns <= end for begin, end in self._stays.get(order, ())):
            return "there"
        begin_ns = max(since_ns, begin_ns)
        last = self._last
        if place is None or last is None or not self._heard:
            return "not_known"
        fits = (_first_ns(silence, place, begin_ns, end_ns) for silence in self._silences)
        if any(first_ns is not None for first_ns in fits):
            return "may_have_been"
        away_m = math.dist(last.at, place)
        return "not_known" if _reached_ns(last, away_m) <= ended_ns else "elsewhere"

    def note_visit(self, place: Point, since_ns: int, arrived_ns: int, ended_ns: int) -> None:
        """A visit in a time when it was not heard is taken for true: it was there then, and in no
        other place.
        """
        begin_ns, end_ns = max(since_ns, arrived_ns - LEEWAY_NS), ended_ns + EARLY_NS
        for number, silence in enumerate(self._silences):
            first_ns = _first_ns(silence, place, begin_ns, end_ns)
            if first_ns is not None:
                there = Sighting(max(first_ns, min(arrived_ns, silence.after.time_ns)), place)
                parts = _Silence(silence.before, there), _Silence(there, silence.after)
                self._silences[number : number + 1] = parts
                return


def _reached_ns(begin: Sighting, away_m: float) -> int:
    """When a vehicle can be so far away at the earliest."""
    return begin.time_ns + round(1e9 * max(0.0, away_m - _SLACK_M) / MAX_MPS)


def _first_ns(silence: _Silence, place: Point, begin_ns: int, end_ns: int) -> int | None:
    """When a vehicle can first have been at a place within a time, in a silence; None: never."""
    after = silence.after
    back_s = max(0.0, math.dist(after.at, place) - _SLACK_M) / MAX_MPS
    latest_ns = min(end_ns, after.time_ns - round(1e9 * back_s))
    earliest_ns = begin_ns
    if silence.before is not None:
        away_m = math.dist(silence.before.at, place)
        earliest_ns = max(begin_ns, _reached_ns(silence.before, away_m))
    return earliest_ns if earliest_ns <= latest_ns else None

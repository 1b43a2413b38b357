"""Street names of a network, and what people write for them."""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Final, TypeAlias

from slipstream.errors import InputError

if TYPE_CHECKING:
    from slipstream.roads import RoadNetwork, Segment

_NEAR: Final = 0.6
"""Likeness (difflib's ratio) from which a name is meant."""
_CROSSING: Final = re.compile(r"\s+(?:&|/|and|und|et|y)\s+|[&/]", re.IGNORECASE)
"""Between the names of streets that meet."""
_SHORT: Final = {
    "ave": "avenue", "blvd": "boulevard", "dr": "drive", "ln": "lane", "pl": "place",
    "rd": "road", "st": "street", "str": "strasse",
}  # fmt: skip


def streets_of(network: RoadNetwork) -> Mapping[str, tuple[Segment, ...]]:
    """Segments by street name; "" has those without one."""
    found: dict[str, list[Segment]] = {}
    for segment in network.segments.values():
        found.setdefault(segment.name, []).append(segment)
    return {name: tuple(segments) for name, segments in found.items()}


Match: TypeAlias = "tuple[tuple[str, ...], tuple[str, ...], tuple[Segment, ...]]"
"""(names of the streets that are meant, junctions that are, segments; the best first each)."""


def matching(query: str, network: RoadNetwork) -> Match:
    """What a query means.

    The segment or junction whose id this is comes first, then the streets that hold what was
    written, or the junctions of two streets with "&" between them; or else segments and junctions
    whose ids hold it, or else the streets most like it.

    Raises:
        InputError: there is none.
    """
    streets = streets_of(network)
    held = _holding(query, streets)
    exact = [network.segments[query]] if query in network.segments else []
    here = (query,) if query in network.junctions else ()
    if held or exact or here:
        segments = (
            *exact,
            *_meeting(network, here),
            *(segment for name in held for segment in streets[name]),
        )
        return held, here, tuple({segment.id: segment for segment in segments}.values())
    parts = [part.strip() for part in _CROSSING.split(query) if part.strip()]
    if len(parts) > 1 and streets.keys() - {""}:
        return _crossing(query, parts, network)
    part = query.strip().casefold()

    def named(ids: Iterable[str]) -> list[str]:
        found = (name for name in ids if part and part in name.casefold())
        return sorted(found, key=lambda name: (len(name), name))

    if ids := named(network.segments):
        return (), (), tuple(network.segments[name] for name in ids)
    if ids := named(network.junctions):
        return (), tuple(ids), _meeting(network, ids)
    names = _like(query, streets, network)
    return names, (), tuple(segment for name in names for segment in streets[name])


def _holding(query: str, streets: Mapping[str, Sequence[Segment]]) -> tuple[str, ...]:
    """Names of streets that hold what was written, the shortest first."""
    wanted = _plain(query)
    words = set(wanted.split())
    held = (
        name
        for name in streets
        if name and wanted and (wanted in _plain(name) or words <= {*_plain(name).split()})
    )
    return tuple(sorted(held, key=lambda name: (len(_plain(name)), name)))


def _like(
    query: str, streets: Mapping[str, Sequence[Segment]], network: RoadNetwork
) -> tuple[str, ...]:
    """Names of the streets that are most like what was written."""
    wanted, named = _plain(query), [name for name in streets if name]
    like = sorted(((_likeness(wanted, _plain(name)), name) for name in named), reverse=True)
    best = like[0][0] if like else 0.0
    if best >= _NEAR:
        # As good as the best one, not all that are barely like it.
        return tuple(name for value, name in like if value >= max(_NEAR, best - 0.1))
    missing = "no segment or junction has it in its id, and"
    if not named:
        mend = "give a place, or import the net with names"
        raise InputError(query, f"{missing} the net has no street names", mend)
    raise InputError(query, f"{missing} no street is called so", f"the nearest is {like[0][1]!r}")


def _crossing(query: str, parts: Sequence[str], network: RoadNetwork) -> Match:
    """The junctions where streets meet."""
    streets = streets_of(network)
    meant = [_holding(part, streets) or _like(part, streets, network) for part in parts]
    ends = [
        {end for name in names for s in streets[name] for end in (s.start, s.end)}
        for names in meant
    ]
    met = sorted(set.intersection(*ends))
    if not met:
        told = " and ".join(repr(names[0]) for names in meant)
        raise InputError(query, f"{told} meet at no junction", "give one street, or a place")
    names = tuple(dict.fromkeys(name for group in meant for name in group))
    return names, tuple(met), _meeting(network, met)


def _meeting(network: RoadNetwork, junctions: Iterable[str]) -> tuple[Segment, ...]:
    """Segments that begin or end at junctions, by junction."""
    by_end: dict[str, list[Segment]] = {}
    for segment in network.segments.values():
        for end in dict.fromkeys((segment.start, segment.end)):
            by_end.setdefault(end, []).append(segment)
    found = (segment for name in junctions for segment in by_end.get(name, ()))
    return tuple({segment.id: segment for segment in found}.values())


def place_of(query: str, network: RoadNetwork) -> tuple[float, float] | None:
    """The place in the network, m, that two numbers with a comma name; None: it is a name.

    Raises:
        InputError: latitude and longitude are nowhere.
    """
    parts = query.split(",")
    try:
        first, second = (float(part) for part in parts)
    except ValueError:
        return None
    if network.projection is None:
        return first, second
    if 180 < abs(second) <= 360:
        # Counted on over the date line, as maps do.
        second -= math.copysign(360.0, second)
    if not (abs(first) <= 90 and abs(second) <= 180):
        mend = "give latitude, then longitude, in degrees"
        raise InputError(query, "no latitude and longitude", mend)
    try:
        return network.projection.place_m(first, second)
    except ValueError as error:
        raise InputError(query, str(error), "give a place of the net") from None


def _plain(text: str) -> str:
    """Without case, accents and points, and with words written out."""
    bare = unicodedata.normalize("NFKD", text.replace("ß", "ss")).casefold()
    kept = "".join(c if c.isalnum() else " " for c in bare if not unicodedata.combining(c))
    return " ".join(_SHORT.get(word, word) for word in kept.split())


def _likeness(a: str, b: str) -> float:
    return difflib.SequenceMatcher(None, a, b).ratio()

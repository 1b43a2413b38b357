"""Street names of a network, and what people write for them."""

from __future__ import annotations

import difflib
import math
import unicodedata
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from slipstream.errors import InputError

if TYPE_CHECKING:
    from slipstream.roads import RoadNetwork, Segment

_NEAR: Final = 0.6
"""Likeness (difflib's ratio) from which a name is meant."""
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


def matching(query: str, network: RoadNetwork) -> tuple[tuple[str, ...], tuple[Segment, ...]]:
    """(names of the streets that are meant, the best first; segments, the best first).

    The segment whose id this is comes first, then those of streets that hold what was written; or
    else those whose ids hold it, or else those of the streets most like it.

    Raises:
        InputError: there is none.
    """
    streets = streets_of(network)
    named = [name for name in streets if name]
    wanted = _plain(query)
    words = set(wanted.split())
    held = [n for n in named if wanted and (wanted in _plain(n) or words <= {*_plain(n).split()})]
    names = tuple(sorted(held, key=lambda name: (len(_plain(name)), name)))
    exact = [network.segments[query]] if query in network.segments else []
    if names or exact:
        segments = (*exact, *(segment for name in names for segment in streets[name]))
        return names, tuple({segment.id: segment for segment in segments}.values())
    part = query.strip().casefold()
    ids = [identifier for identifier in network.segments if part and part in identifier.casefold()]
    if ids:
        return (), tuple(network.segments[i] for i in sorted(ids, key=lambda i: (len(i), i)))
    like = sorted(((_likeness(wanted, _plain(name)), name) for name in named), reverse=True)
    best = like[0][0] if like else 0.0
    if best >= _NEAR:
        # As good as the best one, not all that are barely like it.
        names = tuple(name for value, name in like if value >= max(_NEAR, best - 0.1))
        return names, tuple(segment for name in names for segment in streets[name])
    missing = "no segment's id has it, and"
    if not named:
        mend = "give a place, or import the net with names"
        raise InputError(query, f"{missing} the net has no street names", mend)
    raise InputError(query, f"{missing} no street is called so", f"the nearest is {like[0][1]!r}")


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

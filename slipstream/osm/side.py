"""On which side of the road an OpenStreetMap extract is driven: as told, as the map names it, as
its roundabouts turn, or by where it lies.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from slipstream.errors import InputError
from slipstream.osm.limits import countries_named
from slipstream.osm.survey import Survey, Way

Side = Literal["left", "right"]

_MOST: Final = 2 / 3
"""Share of what the map names, or of its roundabouts, that decides."""
_ARC: Final = 3
"""Nodes of an arc that turns at all."""
_LEFT: Final = frozenset({
    "AG", "AI", "AU", "BB", "BD", "BM", "BN", "BS", "BT", "BW", "CC", "CK", "CX", "CY", "DM",
    "FJ", "FK", "GB", "GD", "GG", "GY", "HK", "ID", "IE", "IM", "IN", "JE", "JM", "JP", "KE",
    "KI", "KN", "KY", "LC", "LK", "LS", "MO", "MS", "MT", "MU", "MV", "MW", "MY", "MZ", "NA",
    "NF", "NP", "NR", "NU", "NZ", "PG", "PK", "PN", "SB", "SC", "SG", "SH", "SR", "SZ", "TC",
    "TH", "TK", "TL", "TO", "TT", "TV", "TZ", "UG", "VC", "VG", "VI", "WS", "ZA", "ZM", "ZW",
})  # fmt: skip
"""Countries that drive on the left (ISO 3166-1); all others drive on the right."""

Box = tuple[float, float, float, float]
"""South, west, north, east; degrees."""

_LEFT_BOXES: Final[Mapping[str, tuple[Box, ...]]] = {
    "Great Britain and Ireland": (
        (50.1, -11.0, 61.0, 1.37), (49.8, -7.0, 50.1, -4.0), (51.15, 1.37, 61.0, 1.95),
        (49.15, -2.75, 49.76, -1.99),
    ),
    "Malta": ((35.7, 14.1, 36.15, 14.65),),
    "Cyprus": ((34.5, 32.2, 35.75, 34.65),),
    "Japan": (
        (30.0, 128.5, 34.0, 142.0), (34.0, 129.15, 34.85, 129.6), (33.9, 130.0, 36.0, 141.2),
        (36.0, 135.0, 41.6, 142.2), (41.3, 139.3, 45.55, 145.4), (24.0, 122.9, 29.5, 131.5),
        (24.0, 140.0, 28.0, 143.0), (43.0, 145.3, 43.42, 145.85), (36.0, 132.8, 36.4, 135.0),
    ),
    "Thailand": (
        (12.0, 99.8, 17.0, 102.0), (17.2, 98.6, 19.5, 100.3), (14.6, 102.0, 17.4, 104.2),
        (5.5, 97.6, 9.7, 102.8),
    ),
    "Malaysia, Singapore, Indonesia, Timor": (
        (-11.0, 95.0, 4.5, 141.0), (4.5, 94.9, 6.0, 105.0), (4.5, 113.8, 7.1, 117.4),
    ),
    "Australia": ((-44.0, 112.0, -9.9, 154.5),),
    "Papua New Guinea and Solomon Islands": (
        (-11.7, 140.0, 0.0, 157.0), (-12.0, 155.0, -5.0, 163.0),
    ),
    "New Zealand": ((-47.5, 166.0, -34.0, 179.0), (-45.0, -177.5, -43.0, -175.5)),
    "Pacific islands": (
        (-19.5, 176.8, -16.0, 180.0), (-19.5, -180.0, -16.0, -178.2),
        (-22.5, -176.3, -15.4, -173.6), (-14.1, -172.9, -13.4, -171.35),
        (-22.0, -160.5, -18.0, -157.0), (-0.6, 166.8, -0.45, 167.0),
        (1.0, 172.7, 3.5, 173.3), (-10.8, 176.0, -5.5, 180.0), (-19.2, -170.0, -18.9, -169.7),
        (-29.2, 167.8, -28.9, 168.1),
    ),
    "India, Pakistan, Bangladesh and their neighbours": (
        (6.0, 68.0, 21.0, 90.0), (21.0, 68.0, 27.0, 88.0), (23.5, 64.0, 29.0, 80.0),
        (29.0, 70.5, 31.5, 78.0), (31.5, 71.2, 34.5, 76.0), (28.5, 66.7, 30.4, 70.5),
        (26.0, 80.0, 27.8, 88.0), (27.8, 80.0, 28.4, 84.8), (21.0, 88.0, 26.9, 92.0),
        (24.2, 92.0, 27.0, 93.9), (26.7, 89.35, 27.7, 91.6), (6.5, 92.0, 13.8, 94.3),
        (-1.0, 72.5, 7.5, 74.0),
    ),
    "Hong Kong": ((22.15, 113.85, 22.4, 114.45),),
    "Southern and eastern Africa": (
        (-35.0, 11.7, -18.1, 41.0), (-18.1, 24.0, -13.6, 41.0), (-13.6, 33.5, -9.0, 41.0),
        (-13.3, 31.5, -9.0, 33.5), (-9.0, 31.2, -1.0, 41.0), (-4.8, 34.0, 3.0, 40.9),
        (-0.9, 31.4, 3.4, 35.0), (-0.9, 30.2, 0.8, 31.4),
    ),
    "Mauritius, Seychelles": (
        (-20.6, 57.2, -19.9, 57.9), (-19.9, 63.2, -19.6, 63.6), (-5.0, 55.0, -4.0, 56.0),
    ),
    "South Atlantic": (
        (-16.1, -5.9, -15.8, -5.6), (-8.1, -14.5, -7.8, -14.2), (-52.6, -61.6, -50.9, -57.6),
    ),
    "Guyana and Suriname": ((4.5, -59.5, 7.2, -54.7),),
    "Caribbean": (
        (23.6, -79.35, 27.3, -74.0), (22.0, -76.2, 23.6, -72.7), (20.9, -73.75, 21.6, -72.95),
        (21.1, -72.5, 22.0, -71.1), (17.6, -78.4, 18.6, -76.1), (19.2, -81.5, 19.8, -79.6),
        (18.25, -65.1, 18.8, -64.2), (17.6, -64.95, 17.85, -64.5), (18.15, -63.5, 18.65, -62.9),
        (17.05, -62.9, 17.45, -62.5), (16.95, -61.95, 17.8, -61.6), (16.65, -62.3, 16.85, -62.1),
        (15.15, -61.55, 15.7, -61.2), (13.65, -61.15, 14.15, -60.8), (11.95, -61.85, 13.45, -61.05),
        (13.0, -59.7, 13.4, -59.35), (10.0, -61.8, 11.4, -60.4), (32.2, -64.95, 32.45, -64.6),
    ),
}  # fmt: skip
"""Boxes that hold no land where the right side is driven on."""
_IN_DOUBT: Final[tuple[Box, ...]] = (
    (5.6, 97.3, 20.5, 105.7), (4.4, 117.4, 7.6, 119.5), (20.5, 60.8, 37.1, 97.5),
    (22.0, 113.4, 22.6, 114.5), (-18.1, 11.7, -16.9, 25.3), (-18.1, 19.9, 5.1, 41.9),
    (1.1, -61.5, 8.6, -53.9), (18.0, -63.5, 18.15, -62.9),
)  # fmt: skip
"""Boxes with borders between the two sides, outside of those above."""


@dataclass(frozen=True)
class DrivingSide:
    """The side, and how it is known, in words."""

    side: Side
    why: str

    def __str__(self) -> str:
        return f"{self.side} ({self.why})"


def driving_side(
    survey: Survey, told: Side | None, country: str | None, source: Path
) -> DrivingSide:
    """On which side an extract's roads are driven.

    Raises:
        InputError: nothing tells, or what tells contradicts each other.
    """
    if told is not None:
        return DrivingSide(told, "as told")
    if country is not None:
        return DrivingSide(_side_of(country), f"the country is {country}")
    known = [*_evidence(survey)]
    mend = "say it: --driving-side left or right, or --country with its code"
    if not known:
        problem = "driven on which side? It lies near a border between left and right"
        raise InputError(source, problem, mend, key="--driving-side")
    against = next((found for found in known if found.side != known[0].side), None)
    if against is not None:
        problem = f"driven on which side? {known[0]}, but {against}"
        raise InputError(source, problem, mend, key="--driving-side")
    return known[0]


def _evidence(survey: Survey) -> Iterator[DrivingSide]:
    """The side by each thing that tells, the surest first."""
    named = clear(survey.sides)
    if named is not None:
        yield DrivingSide(_named(named), "by the map's driving_side")
    country = country_of(survey)
    if country is not None:
        yield DrivingSide(_side_of(country), f"the map's country is {country}")
    lies = side_at(survey.places.values())
    if lies is not None:
        yield lies
    found = (_roundabout_side(way, survey.places) for way in survey.open_roads.values())
    turns: Counter[str] = Counter(side for side in found if side is not None)
    most = clear(turns)
    if most is not None:
        why = f"as {turns[most]} of {turns.total()} roundabouts turn"
        yield DrivingSide(_named(most), why)


def _named(side: str) -> Side:
    return "left" if side == "left" else "right"


def _side_of(country: str) -> Side:
    return "left" if country in _LEFT else "right"


def country_of(survey: Survey) -> str | None:
    """The country that the map names by far most often; None: it names none."""
    return clear(survey.countries + countries_named(survey.open_roads.values()))


def clear(counts: Counter[str]) -> str | None:
    """What most of the counts name; None: nothing by far."""
    best = counts.most_common(1)
    return best[0][0] if best and best[0][1] >= _MOST * counts.total() else None


def side_at(places: Iterable[tuple[float, float]]) -> DrivingSide | None:
    """The side that is driven on where places lie (degrees); None: near a border, or they lie on
    both sides of one.
    """
    points = np.array(list(places), dtype=np.float64).reshape(-1, 2)
    left = np.zeros(len(points), dtype=bool)
    names = []
    for name, boxes in _LEFT_BOXES.items():
        inside = np.any([_holds(box, points) for box in boxes], axis=0)
        names += [name] if inside.any() else []
        left |= inside
    if len(points) and left.all():
        return DrivingSide("left", f"it lies in {' and '.join(names)}")
    if left.any() or any(_holds(box, points).any() for box in _IN_DOUBT):
        return None
    return DrivingSide("right", "it lies in no country that drives on the left")


def _holds(box: Box, points: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    south, west, north, east = box
    lat, lon = points.T
    inside: npt.NDArray[np.bool_] = (south <= lat) & (lat <= north) & (west <= lon) & (lon <= east)
    return inside


def _roundabout_side(way: Way, places: Mapping[int, tuple[float, float]]) -> Side | None:
    """The side of the traffic in a roundabout, or an arc of one; None: it is none."""
    if way.tags.get("junction") != "roundabout":
        return None
    known = [places[node] for node in way.nodes if node in places]
    if len(known) < _ARC:
        return None
    lat, lon = np.array(known).T
    east = ((lon - lon[0] + 540.0) % 360.0 - 180.0) * np.cos(np.radians(lat[0]))
    dx, dy = np.diff(east), np.diff(lat)
    turn = float((dx[:-1] * dy[1:] - dx[1:] * dy[:-1]).sum())
    if turn == 0:
        return None
    against = way.tags.get("oneway") in ("-1", "reverse")
    return "right" if (turn > 0) != against else "left"

"""Speed limits of OpenStreetMap's ways: signed ones in km/h, and for the others what the law of the
country says inside and outside of built-up areas.

netconvert takes the value of a road's class where `maxspeed` is no number: 100 km/h on primary and
secondary roads, in towns too.

The countries' limits were compared with OpenStreetMap's table of default speed limits as of October
2024 (passenger cars), which has most urban and rural ones and some of motorways. Finland's rural
limit is 100 km/h there; the lower one is kept. Belgium, Canada and the United States have limits by
region: one of each is taken.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from slipstream.osm.built_up import BuiltUp
from slipstream.osm.survey import FOR_CARS, Survey, Way

Zone = Literal["urban", "rural", "motorway"]

_MPH: Final = 1.609344
_MILES: Final = frozenset({"GB", "US"})
_LAW: Final[Mapping[str, tuple[int, int, int]]] = {
    "AT": (50, 100, 130), "AU": (50, 100, 110), "BE": (50, 90, 120), "BG": (50, 90, 140),
    "BY": (60, 90, 110), "CA": (50, 80, 100), "CH": (50, 80, 120), "CY": (50, 80, 100),
    "CZ": (50, 90, 130), "DE": (50, 100, 130), "DK": (50, 80, 130), "EE": (50, 90, 90),
    "ES": (30, 90, 120), "FI": (50, 80, 120), "FR": (50, 80, 130), "GB": (30, 60, 70),
    "GR": (50, 90, 130), "HR": (50, 90, 130), "HU": (50, 90, 130), "IE": (50, 80, 120),
    "IS": (50, 90, 90), "IT": (50, 90, 130), "JP": (60, 60, 100), "LI": (50, 80, 120),
    "LT": (50, 90, 130), "LU": (50, 90, 130), "LV": (50, 90, 90), "MT": (50, 80, 80),
    "NL": (50, 80, 100), "NO": (50, 80, 110), "NZ": (50, 100, 100), "PL": (50, 90, 140),
    "PT": (50, 90, 120), "RO": (50, 90, 130), "RS": (50, 80, 120), "RU": (60, 90, 110),
    "SE": (50, 70, 110), "SI": (50, 90, 130), "SK": (50, 90, 130), "TR": (50, 90, 120),
    "UA": (50, 90, 130), "US": (30, 55, 65), "ZA": (60, 100, 120),
}  # fmt: skip
"""(urban, rural, motorway) limit, km/h, in `_MILES` mph; Germany's motorway: the advised one."""
_OTHERS: Final = (50, 80, 120)
"""Where the country is not known: what most have inside towns, and the lower of what they have
outside."""
_ZONES: Final[Mapping[Zone, int]] = {"urban": 0, "rural": 1, "motorway": 2}
_CLASS_KMH: Final[Mapping[str, float]] = {
    "tertiary": 80, "unclassified": 50, "road": 50, "residential": 50,
    **{f"{name}_link": 80 for name in ("motorway", "trunk", "primary", "secondary", "tertiary")},
}  # fmt: skip
"""Roads that are driven more slowly than the law allows outside of towns: netconvert's values."""
_WITHOUT: Final = frozenset({"living_street"})
"""Walking pace, as netconvert has it."""
_SAID: Final = ("maxspeed", "maxspeed:type", "source:maxspeed", "zone:traffic", "zone:maxspeed")
_NUMBER: Final = re.compile(r"(\d+(?:\.\d+)?)\s*(km/?h|kph|kmh|mph|knots)?", re.IGNORECASE)
_UNITS: Final[Mapping[str, float]] = {"mph": _MPH, "knots": 1.852}
_SIGNED: Final = frozenset({"none", "walk"})
"""Values without a number that netconvert reads."""
_IMPLICIT: Final = re.compile(
    r"(?:([A-Z]{2})(?:-[A-Z]+)?[:_])?(?:zone:?)?([a-z_]+|\d+)", re.IGNORECASE
)
_WORDS: Final[Mapping[str, Zone]] = {
    "urban": "urban", "rural": "rural", "motorway": "motorway", "nsl_restricted": "urban",
    "nsl_single": "rural", "nsl_dual": "motorway", "nsl": "rural",
}  # fmt: skip


@dataclass(frozen=True)
class Limit:
    """The limit of a way that has none signed.

    Attributes:
        kmh: taken.
        why: in words.
    """

    kmh: float
    why: str


def signed_kmh(tags: Mapping[str, str]) -> float | str | None:
    """The limit in a way's `maxspeed`, km/h, of several the lowest; a word that netconvert reads;
    None: none is signed, or it is no number.
    """
    text = tags.get("maxspeed", "").strip()
    if text.lower() in _SIGNED:
        return text.lower()
    parts = [part.strip() for part in re.split(r"[;|,]", text) if part.strip()]
    found = [_NUMBER.fullmatch(part) for part in parts]
    if not found or not all(found):
        return None
    kmh = min(float(m[1]) * _UNITS.get((m[2] or "").lower(), 1.0) for m in found if m)
    return kmh if kmh > 0 else None


def implied(tags: Mapping[str, str]) -> tuple[str | None, Zone | float] | None:
    """(country, zone or limit in the country's unit) that tags say instead of a number, such as
    "FR:urban" or "DE:zone30"; None: nothing.
    """
    for key in _SAID:
        found = _IMPLICIT.fullmatch(tags.get(key, "").strip())
        if found is None:
            continue
        country, word = (found[1] or "").upper() or None, found[2].lower()
        if word in _WORDS:
            return country, _WORDS[word]
        number = word.removeprefix("zone")
        if number.isdigit() and (country is not None or key == "zone:maxspeed"):
            return country, float(number)
    return None


def countries_named(ways: Iterable[Way]) -> Counter[str]:
    """How often ways name a country with their limit."""
    named = (implied(way.tags) for way in ways)
    return Counter(found[0] for found in named if found is not None and found[0] is not None)


def law_kmh(country: str | None, zone: Zone) -> float:
    """The limit of a country's law for cars, km/h; of one that is not known, of most."""
    value = _LAW.get(country or "", _OTHERS)[_ZONES[zone]]
    return round(value * _MPH, 1) if country in _MILES else value


def limits(survey: Survey, country: str | None) -> dict[int, Limit]:
    """Limits of the open roads for cars that have none signed, by way."""
    return dict(_limits(survey, country))


def _limits(survey: Survey, country: str | None) -> Iterator[tuple[int, Limit]]:
    area = BuiltUp(survey)
    for number, way in survey.open_roads.items():
        if way.road_class not in FOR_CARS - _WITHOUT or signed_kmh(way.tags) is not None:
            continue
        if {"maxspeed:forward", "maxspeed:backward"} <= way.tags.keys():
            continue
        said = implied(way.tags)
        if said is not None:
            whose, value = said[0] or country, said[1]
            if isinstance(value, float):
                kmh = value * (_MPH if whose in _MILES else 1.0)
                yield number, Limit(round(kmh, 1), "by the zone that tags name")
            else:
                yield number, Limit(law_kmh(whose, value), f"{value}, as tags say")
            continue
        zone, why = _zone(way, area)
        kmh = law_kmh(country, zone)
        if zone != "urban":
            kmh = min(kmh, _CLASS_KMH.get(way.road_class, kmh))
        yield number, Limit(kmh, why)


def _zone(way: Way, area: BuiltUp) -> tuple[Zone, str]:
    if way.road_class == "motorway":
        return "motorway", "motorways"
    if way.road_class == "residential":
        return "urban", "residential streets"
    if way.road_class == "motorway_link" or way.tags.get("motorroad") == "yes":
        return "rural", "outside of built-up areas"
    if way.tags.get("sidewalk", "no") not in ("no", "none"):
        return "urban", "inside of built-up areas"
    if not area.is_known:
        return "urban", "counted as built-up: the extract has nothing that tells town from country"
    if area.holds(way):
        return "urban", "inside of built-up areas"
    return "rural", "outside of built-up areas"

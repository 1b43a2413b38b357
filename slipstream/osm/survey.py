"""What an OpenStreetMap extract has: its roads, its built-up areas, and the country it names."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from slipstream.errors import InputError
from slipstream.osm.extract import Extract, Thing

DEGREE_M: Final = 111_195.0
"""Of latitude."""
_CLOSED: Final = frozenset({"no", "private", "agricultural", "forestry", "emergency"})
"""Values of `access` and the like by which nobody delivers there."""
FOR_CARS: Final = frozenset(
    {
        *(f"{name}{link}" for name in ("motorway", "trunk", "primary") for link in ("", "_link")),
        *("secondary", "secondary_link", "tertiary", "tertiary_link"),
        *("unclassified", "residential", "living_street", "road"),
    }
)
_BUILT_UP: Final[Mapping[str, frozenset[str]]] = {
    "landuse": frozenset({"residential", "commercial", "retail", "industrial"}),
    "place": frozenset(
        {"city", "borough", "suburb", "quarter", "neighbourhood", "town", "village", "hamlet"}
    ),
}
_NO_TUNNEL: Final = ("", "no")


@dataclass(frozen=True)
class Way:
    """A way with a road class: its value of `highway`, its nodes, whether tags close it to cars."""

    road_class: str
    nodes: tuple[int, ...]
    closed: bool
    tags: Mapping[str, str] = field(default_factory=dict, compare=False)

    @property
    def in_tunnel(self) -> bool:
        """Whether it is tagged as a tunnel of any kind."""
        return self.tags.get("tunnel", "") not in _NO_TUNNEL


@dataclass
class Survey:
    """What an extract has.

    Attributes:
        roads: ways with a road class, by id.
        railways: ways of rail without one.
        others: ways with neither: buildings, water, borders.
        restrictions: turn restrictions.
        areas: built-up ones, each as lines of nodes that bound it.
        countries: how often ways and relations name a country, by its code (ISO 3166-1).
        sides: how often relations name the side that is driven on; or else ways, if most do: a few
            alone have a side of their own.
        places: latitude and longitude of nodes of roads and areas, degrees.
    """

    roads: dict[int, Way] = field(default_factory=dict)
    railways: int = 0
    others: int = 0
    restrictions: int = 0
    areas: list[tuple[tuple[int, ...], ...]] = field(default_factory=list)
    countries: Counter[str] = field(default_factory=Counter)
    sides: Counter[str] = field(default_factory=Counter)
    places: dict[int, tuple[float, float]] = field(default_factory=dict)

    def is_wanted(self, thing: Thing) -> bool:
        """Whether a way is a road that no tag closes to cars, or a relation restricts turns."""
        if thing.kind == "way":
            return thing.id in self.roads and not self.roads[thing.id].closed
        return _is_restriction(thing)

    def length_m(self, way: Way) -> float:
        """Length of a way, m, on a sphere."""
        known = [self.places[node] for node in way.nodes if node in self.places]
        length_m = 0.0
        for (lat, lon), (lat2, lon2) in pairwise(known):
            east = ((lon2 - lon + 540.0) % 360.0 - 180.0) * math.cos(math.radians(lat))
            length_m += DEGREE_M * math.hypot(east, lat2 - lat)
        return length_m

    @property
    def open_roads(self) -> dict[int, Way]:
        """Those that no tag closes to cars."""
        return {number: way for number, way in self.roads.items() if not way.closed}

    @property
    def road_nodes(self) -> set[int]:
        """Nodes of the open roads."""
        return {node for way in self.open_roads.values() for node in way.nodes}


def survey_of(extract: Extract) -> Survey:
    """Read what an extract has.

    Raises:
        InputError: it is damaged, or has no road.
    """
    survey = Survey()
    rings: list[tuple[int, ...]] = []
    way_sides: Counter[str] = Counter()
    for thing in extract.things(("way", "relation"), ()):
        _name_country(survey, thing)
        side = thing.tags.get("driving_side")
        if side in ("left", "right"):
            (way_sides if thing.kind == "way" else survey.sides)[side] += 1
        if thing.kind == "way":
            _take_way(survey, thing)
        elif _is_restriction(thing):
            survey.restrictions += 1
        elif _is_built_up(thing):
            rings.append(tuple(ref for kind, ref, _ in thing.members if kind == "way"))
    if not survey.sides and 2 * way_sides.total() >= len(survey.open_roads):
        survey.sides = way_sides
    if not survey.roads:
        raise InputError(extract.path, "no way with a road class (highway) in it", "extract more")
    if rings:
        members = {way for ring in rings for way in ring}
        lines = {t.id: t.nodes for t in extract.things(("way",), ()) if t.id in members}
        survey.areas += [tuple(lines[way] for way in ring if way in lines) for ring in rings]
    nodes = survey.road_nodes
    nodes.update(node for area in survey.areas for line in area for node in line)
    survey.places.update((t.id, t.place) for t in extract.things(("node",), nodes))
    return survey


def _take_way(survey: Survey, thing: Thing) -> None:
    tags = thing.tags
    if "highway" in tags:
        keys = ("motorcar", "motor_vehicle", "vehicle", "access")
        access = next((tags[key] for key in keys if key in tags), "yes")
        closed = access in _CLOSED
        survey.roads[thing.id] = Way(tags["highway"], thing.nodes, closed, {} if closed else tags)
        return
    if "railway" in tags:
        survey.railways += 1
    else:
        survey.others += 1
    if _is_built_up(thing) and thing.nodes[:1] == thing.nodes[-1:]:
        survey.areas.append((thing.nodes,))


def _name_country(survey: Survey, thing: Thing) -> None:
    """Count what a way or relation says of its country."""
    for key in ("ISO3166-1", "ISO3166-1:alpha2", "ISO3166-2", "addr:country", "is_in:country_code"):
        code = thing.tags.get(key, "")[:2].upper()
        if len(code) == 2 and code.isalpha() and thing.tags[key][2:3] in ("", "-"):
            survey.countries[code] += 1


def _is_restriction(thing: Thing) -> bool:
    return thing.kind == "relation" and thing.tags.get("type", "").startswith("restriction")


def _is_built_up(thing: Thing) -> bool:
    return any(thing.tags.get(key) in values for key, values in _BUILT_UP.items())

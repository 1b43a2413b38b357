"""From an OpenStreetMap extract to a net, with what of it was left out, and why."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from slipstream.errors import InputError
from slipstream.osm.extract import open_extract, write_roads
from slipstream.osm.limits import Limit, limits, signed_kmh
from slipstream.osm.netconvert import (
    OPTIONS,
    convert,
    first_warning,
    keep,
    warnings_of,
)
from slipstream.osm.side import DrivingSide, Side, country_of, driving_side
from slipstream.osm.survey import FOR_CARS, Survey, survey_of
from slipstream.roads.sumo_files import elements

_LIMITS: Final = (
    "maxheight",
    "maxwidth",
    "maxlength",
    "maxweight",
    "maxweightrating",
    "maxaxleload",
)
_OPTIONS: Final = (
    *("--geometry.remove", "true"),
    *("--roundabouts.guess", "true"),
    *("--ramps.guess", "true"),
    *("--junctions.join", "true"),
    *("--tls.guess-signals", "true"),
    *("--tls.discard-simple", "true"),
    *("--tls.join", "true"),
    *("--keep-edges.by-vclass", "passenger"),
    *("--keep-edges.components", "1"),
    *("--remove-edges.isolated", "true"),
    # Edges by OpenStreetMap's ways, the limits that roads have (`roads.access`), and tunnels.
    *("--output.original-names", "true"),
    *("--osm.all-attributes", "true"),
    *("--osm.extra-attributes", ",".join((*_LIMITS, "tunnel"))),
    *("--aggregate-warnings", "-1"),
)
_FOR_WALKING: Final = frozenset(
    {"footway", "path", "pedestrian", "steps", "cycleway", "bridleway", "corridor", "track"}
)
_IGNORED: Final = "Ignoring restriction relation"
"""A warning of netconvert that is counted by itself."""


@dataclass(frozen=True)
class Import:
    """A net from OpenStreetMap.

    Attributes:
        net: the file.
        ways: with a road class that are in it.
        left_out: ways that are not, by reason.
        restrictions: turn restrictions of the extract.
        ignored_restrictions: of them, that netconvert could not apply.
        side: that is driven on.
        country: its code, as told or as the map names it; None: not known.
        assumed: km of roads whose limit is not signed, by the limit that is taken, km/h, and why.
        warnings: other warnings of netconvert by the first of their kind.
    """

    net: Path
    ways: int
    left_out: Mapping[str, int]
    restrictions: int
    ignored_restrictions: int
    side: DrivingSide
    country: str | None
    assumed: Mapping[tuple[float, str], float]
    warnings: Mapping[str, int]


def import_osm(
    extract: Path, path: Path, *, side: Side | None = None, country: str | None = None
) -> Import:
    """Build a net from an OpenStreetMap extract: roads for cars, ramps and signals guessed.

    Args:
        extract: ``.osm`` or ``.osm.xml``, plain or packed with gzip or bzip2, or ``.osm.pbf``.
        path: of the net; compressed if it ends in ``.gz``.
        side: that is driven on; None: by the map, or else by where it lies.
        country: ISO 3166-1 code, for that side and for limits that are not signed; None: the one
            that the map names.

    Raises:
        InputError: the extract does not exist, is none or has no road; nothing tells its side;
            netconvert is not installed or refuses it.
        ModuleNotFoundError: a ``.osm.pbf`` without osmium.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        opened = open_extract(extract, folder)
        survey = survey_of(opened)
        driven = driving_side(survey, side, country, extract)
        country = country or country_of(survey)
        assumed = limits(survey, country)
        roads, built = folder / "roads.osm.xml", folder / "built.net.xml"
        write_roads(opened, roads, survey.is_wanted, survey.road_nodes, _added(survey, assumed))
        options = ["--osm-files", str(roads), *OPTIONS, *_OPTIONS]
        options += ["--lefthand", "true"] if driven.side == "left" else []
        said = convert(options, built, extract)
        used = _ways_of(built)
        if not used:
            problem = f"no road for cars in it{first_warning(said)}"
            raise InputError(extract, problem, "extract more")
        keep(built, path)
    return Import(
        path,
        len(used),
        left_out(survey, used),
        survey.restrictions,
        said.count(_IGNORED),
        driven,
        country,
        _assumed_km(survey, assumed, used),
        {text: count for text, count in warnings_of(said).items() if _IGNORED not in text},
    )


def _added(survey: Survey, assumed: Mapping[int, Limit]) -> dict[int, dict[str, str]]:
    """Tags that hold instead of the extract's, by way: limits as plain numbers; and that a road is
    in no tunnel, where one goes on: netconvert makes one edge of both.
    """
    roads = survey.open_roads
    in_tunnels = {node for way in roads.values() if way.in_tunnel for node in way.nodes}
    added: dict[int, dict[str, str]] = {}
    for number, way in roads.items():
        tags = added.setdefault(number, {})
        limit = assumed.get(number)
        signed = signed_kmh(way.tags) if limit is None else limit.kmh
        if signed is not None:
            tags["maxspeed"] = f"{signed:g}" if isinstance(signed, float | int) else signed
        if not way.in_tunnel and in_tunnels.intersection(way.nodes):
            tags["tunnel"] = "no"
    return added


def _assumed_km(
    survey: Survey, assumed: Mapping[int, Limit], used: frozenset[int]
) -> dict[tuple[float, str], float]:
    """Length of the net's roads by limit and why it was taken, the longest first."""
    found: dict[tuple[float, str], float] = {}
    for number, limit in assumed.items():
        if number in used:
            key, km = (limit.kmh, limit.why), survey.length_m(survey.roads[number]) / 1000
            found[key] = found.get(key, 0.0) + km
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _ways_of(net: Path) -> frozenset[int]:
    """OpenStreetMap's ways that a net's lanes are made of."""
    found: set[int] = set()
    for element in elements(net):
        if element.tag == "param" and element.get("key") == "origId":
            numbers = element.get("value", "").split()
            found.update(int(number) for number in numbers if number.lstrip("-").isdigit())
    return frozenset(found)


def left_out(survey: Survey, used: frozenset[int]) -> dict[str, int]:
    """Ways of an extract that a net has not, by reason, the most frequent one first."""
    joined = _connected(survey, used)
    reasons: Counter[str] = Counter()
    for number, way in survey.roads.items():
        if number in used:
            continue
        if way.road_class in _FOR_WALKING:
            reason = "footways, cycleways, paths, tracks"
        elif way.road_class == "service":
            reason = "service roads (drives, alleys, car parks)"  # netconvert: no through traffic
        elif way.road_class not in FOR_CARS:
            reason = f"no road for cars ({way.road_class})"
        elif way.closed:
            reason = "closed to cars (access, vehicle, motor_vehicle, motorcar)"
        elif joined[way.nodes[0]] if way.nodes else False:
            reason = "inside a junction that was joined, or ending where nothing goes on"
        else:
            reason = "not connected to the others"
        reasons[reason] += 1
    reasons["railways"] += survey.railways
    reasons["no road class (buildings, water, borders)"] += survey.others
    return {reason: count for reason, count in reasons.most_common() if count}


def _connected(survey: Survey, used: frozenset[int]) -> Mapping[int, bool]:
    """By node: whether roads for cars lead from it to one that is used, in any direction."""
    ways = {n: w.nodes for n, w in survey.roads.items() if w.nodes and w.road_class in FOR_CARS}
    index = {node: i for i, node in enumerate({node for nodes in ways.values() for node in nodes})}
    steps = [(index[nodes[0]], index[node]) for nodes in ways.values() for node in nodes]
    begins, ends = np.array(steps, dtype=np.int64).reshape(-1, 2).T
    graph = csr_array((np.ones(len(steps)), (begins, ends)), shape=(len(index), len(index)))
    _, part = connected_components(graph, directed=False)
    kept = {part[index[nodes[0]]] for number, nodes in ways.items() if number in used}
    return {node: part[i] in kept for node, i in index.items()}

"""Route files of a net's own: whether they fit the net, and which segments their vehicles use."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, fromstring

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.sumo import (
    FLEET_PREFIX,
    FLEET_TYPES,
    TYPES,
    check_no_include,
    check_vehicle_files,
    elements,
)

_TYPES: Final = ("vType", "vTypeDistribution")
_VEHICLES: Final = ("vehicle", "trip", "flow")
_DAY_S: Final = 86400.0


def check_routes(paths: Sequence[Path], segments: Iterable[str]) -> None:
    """Check that route files belong to a net: every edge that their routes name is a segment.

    Raises:
        InputError: one cannot be read, includes another file or names another net's edge, none
            has a vehicle, or one has a type or a vehicle that is named as the fleet's are.
    """
    check_vehicle_files(tuple(paths))
    known, vehicles = set(segments), 0
    for path in paths:
        for element in elements(path):
            check_no_include(element, path)
            _check_names(element, path)
            edges = element.get("edges", "").split() if element.tag == "route" else []
            for end in ("from", "to"):
                edges += [element.get(end, "")] if element.tag in ("trip", "flow") else []
            strange = next((edge for edge in edges if edge and edge not in known), None)
            if strange is not None:
                raise InputError(
                    path,
                    f"a route over {strange!r}, which the net has not",
                    "give the route file of this net",
                    key=element.get("id"),
                )
            if element.tag in _VEHICLES:
                vehicles += 1
                element.clear()
    if not vehicles:
        raise InputError(
            ", ".join(map(str, paths)), "no vehicle in it", "give a route file with vehicles"
        )


def check_additional(paths: Sequence[Path]) -> None:
    """Check that additional files are XML and no nets, include no others, and name nothing as the
    fleet is named. Raises InputError: one is not, or does.
    """
    check_vehicle_files(tuple(paths))
    for path in paths:
        for element in elements(path):
            check_no_include(element, path)
            _check_names(element, path)


def _check_names(element: Element, path: Path) -> None:
    name = element.get("id", "")
    if element.tag in _TYPES and name in FLEET_TYPES and not _is_fleet_type(element):
        problem = f"a vehicle type {name!r}: that is the fleet's, which is added to every net"
        raise InputError(path, problem, "remove or rename it", key=name)
    if element.tag in _VEHICLES and name.startswith(FLEET_PREFIX):
        problem = f"a vehicle whose name begins with {FLEET_PREFIX!r}, as the fleet's do"
        raise InputError(path, problem, "rename it", key=name)


def has_fleet_type(paths: Sequence[Path]) -> bool:
    """Whether files have the fleet's vehicle type themselves, as scenarios' route files do."""
    return any(_is_fleet_type(element) for path in paths for element in elements(path))


def _is_fleet_type(element: Element) -> bool:
    if element.tag != "vType" or element.get("id") not in FLEET_TYPES:
        return False
    kind = TYPES.get(element.get("id", ""))
    return kind is not None and element.attrib == fromstring(kind.xml()).attrib


def count_passages(paths: Sequence[Path], network: RoadNetwork) -> dict[str, int]:
    """How many vehicles of route files drive over each segment that any does.

    Vehicles without a route take the quickest way on empty roads. What leaves the network (the
    part that a scenario uses) counts where it is inside.
    """
    routes: dict[str, tuple[str, ...]] = {}
    over: Counter[tuple[str, ...]] = Counter()
    between: Counter[tuple[str, str]] = Counter()
    for path in paths:
        for element in elements(path):
            if element.tag == "route" and element.get("id"):
                routes[element.get("id", "")] = tuple(element.get("edges", "").split())
            if element.tag not in _VEHICLES:
                continue
            count, inner = _vehicles_of(element), element.find("route")
            if inner is not None:
                over[tuple(inner.get("edges", "").split())] += count
            elif element.get("route") in routes:
                over[routes[element.get("route", "")]] += count
            else:
                between[element.get("from", ""), element.get("to", "")] += count
            element.clear()
    found: Counter[str] = Counter()
    for way, count in (*over.items(), *_quickest(between, network)):
        found.update(dict.fromkeys((name for name in way if name in network.segments), count))
    return dict(found)


def _vehicles_of(element: Element) -> int:
    """Vehicles of a vehicle, a trip (one) or a flow (by its number, or its rate and time)."""
    if element.tag != "flow":
        return 1
    try:
        if "number" in element.attrib:
            return int(element.get("number", "0"))
        lasts_s = float(element.get("end", _DAY_S)) - float(element.get("begin", 0.0))
        rate = float(element.get("vehsPerHour", element.get("perHour", 0.0))) / 3600
        rate = rate or float(element.get("probability", 0.0))
        if "period" in element.attrib:
            rate = 1 / float(element.get("period", ""))
        return round(rate * lasts_s)
    except (ValueError, ZeroDivisionError, OverflowError):
        return 1  # times and periods that only SUMO understands


def _quickest(
    between: Counter[tuple[str, str]], network: RoadNetwork
) -> Iterable[tuple[tuple[str, ...], int]]:
    """Quickest ways on empty roads between pairs of segments, with their counts."""
    names = tuple(network.segments)
    index = {name: i for i, name in enumerate(names)}
    pairs = sorted((a, b, n) for (a, b), n in between.items() if a in index and b in index)
    free_s = np.array([network.segments[name].free_flow_s for name in names])
    turns = [(index[a], index[b]) for a in names for b in network.follows.get(a, ())]
    start, onto = np.array(turns, dtype=np.int64).reshape(-1, 2).T
    graph = csr_array((free_s[onto], (start, onto)), shape=(len(names), len(names)))
    for origin, group in groupby(pairs, key=itemgetter(0)):
        _, before = dijkstra(graph, indices=index[origin], return_predecessors=True)
        for _, destination, count in group:
            way, at = [destination], int(before[index[destination]])
            while at >= 0:
                way.append(names[at])
                at = int(before[at])
            if way[-1] == origin:
                yield tuple(way), count

"""From an OpenStreetMap extract to a net, with what of it was left out, and why."""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from simulation.scenarios.networks.netconvert import OPTIONS, convert, keep
from simulation.scenarios.networks.osm_extract import Survey, read_extract
from simulation.sumo import elements
from slipstream.errors import InputError

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
    # Edges by OpenStreetMap's ways, and the limits that roads have (`slipstream.access`).
    *("--output.original-names", "true"),
    *("--osm.all-attributes", "true"),
    *("--osm.extra-attributes", "maxheight,maxwidth,maxlength,maxweight,maxweightrating"),
    *("--aggregate-warnings", "-1"),
)
_FOR_WALKING: Final = frozenset(
    {"footway", "path", "pedestrian", "steps", "cycleway", "bridleway", "corridor", "track"}
)
_FOR_CARS: Final = frozenset(
    {
        *(f"{name}{link}" for name in ("motorway", "trunk", "primary") for link in ("", "_link")),
        *("secondary", "secondary_link", "tertiary", "tertiary_link"),
        *("unclassified", "residential", "living_street", "road"),
    }
)
_IGNORED: Final = re.compile(r"Ignoring restriction relation")


@dataclass(frozen=True)
class Import:
    """A net from OpenStreetMap.

    Attributes:
        net: the file.
        ways: with a road class that are in it.
        left_out: ways that are not, by reason.
        restrictions: turn restrictions of the extract.
        ignored_restrictions: of them, that netconvert could not apply.
    """

    net: Path
    ways: int
    left_out: Mapping[str, int]
    restrictions: int
    ignored_restrictions: int


def import_osm(extract: Path, path: Path) -> Import:
    """Build a net from an OpenStreetMap extract: roads for cars, ramps and signals guessed.

    Args:
        extract: ``.osm`` or ``.osm.xml``, plain or packed with gzip or bzip2, or ``.osm.pbf``.
        path: of the net; compressed if it ends in ``.gz``.

    Raises:
        InputError: the extract does not exist, is none or has no road; netconvert is not installed
            or refuses it.
        ModuleNotFoundError: a ``.osm.pbf`` without osmium.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        roads, survey = read_extract(extract, folder)
        built = folder / "built.net.xml"
        said = convert(["--osm-files", str(roads), *OPTIONS, *_OPTIONS], built, extract)
        used = _ways_of(built)
        if not used:
            raise InputError(extract, "no road for cars in it", "extract more")
        keep(built, path)
    return Import(
        path,
        len(used),
        left_out(survey, used),
        survey.restrictions,
        sum(_IGNORED.search(line) is not None for line in said.splitlines()),
    )


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
        elif way.road_class not in _FOR_CARS:
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
    parent: dict[int, int] = {}

    def root(node: int) -> int:
        parent.setdefault(node, node)
        while parent[node] != node:
            parent[node] = node = parent[parent[node]]
        return node

    kept = []
    for number, way in survey.roads.items():
        if way.nodes and way.road_class in _FOR_CARS:
            first = root(way.nodes[0])
            for node in way.nodes[1:]:
                parent[root(node)] = first
            kept += [way.nodes[0]] if number in used else []
    roots = {root(node) for node in kept}
    return {node: root(node) in roots for node in list(parent)}

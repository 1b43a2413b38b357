"""Reads an OpenStreetMap extract: its open roads as XML for netconvert, and what else it has.

netconvert opens a road to cars though `motor_vehicle` or `vehicle` is `no` and `access` is not, so
that closed roads are left out here.
"""

from __future__ import annotations

import bz2
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final, cast
from xml.etree import ElementTree

from slipstream.errors import InputError
from slipstream.files import BoundedReader, check_file, open_unpacked

MAX_EXTRACT_BYTES: Final = 2_000_000_000
"""Of an extract, unpacked."""
_FORMATS: Final = (".osm", ".osm.xml", ".osm.gz", ".osm.xml.gz", ".osm.bz2", ".osm.xml.bz2")
_MEND: Final = "give .osm or .osm.xml (also .gz, .bz2), or .osm.pbf"
_CLOSED: Final = frozenset({"no", "private", "agricultural", "forestry", "emergency"})
"""Values of `access` and the like by which nobody delivers there."""
_CHUNK_BYTES: Final = 1 << 20


@dataclass(frozen=True)
class Way:
    """A way with a road class: its value of `highway`, its nodes, whether tags close it to cars."""

    road_class: str
    nodes: tuple[int, ...]
    closed: bool


@dataclass
class Survey:
    """What an extract has.

    Attributes:
        roads: ways with a road class, by id.
        railways: ways of rail without one.
        others: ways with neither: buildings, water, borders.
        restrictions: turn restrictions.
    """

    roads: dict[int, Way] = field(default_factory=dict)
    railways: int = 0
    others: int = 0
    restrictions: int = 0

    def add_way(self, number: int, tags: dict[str, str], nodes: tuple[int, ...]) -> None:
        """Take in a way."""
        road_class = tags.get("highway")
        if road_class is not None:
            keys = ("motorcar", "motor_vehicle", "vehicle", "access")
            access = next((tags[key] for key in keys if key in tags), "yes")
            self.roads[number] = Way(road_class, nodes, access in _CLOSED)
        elif "railway" in tags:
            self.railways += 1
        else:
            self.others += 1

    def add_relation(self, tags: dict[str, str]) -> None:
        """Take in a relation."""
        self.restrictions += _is_restriction(tags)

    def is_open(self, number: int) -> bool:
        """Whether a way is a road that no tag closes to cars."""
        return number in self.roads and not self.roads[number].closed


def read_extract(path: Path, folder: Path) -> tuple[Path, Survey]:
    """The open roads of an extract, with their restrictions, as XML in a folder; and what it has.

    A ``.osm.pbf`` needs the package osmium.

    Raises:
        InputError: there is no such file, its format is not known or it is damaged, or it has no
            road.
        ModuleNotFoundError: osmium is not installed.
    """
    check_file(path, MAX_EXTRACT_BYTES, "give an OpenStreetMap extract")
    roads, survey = folder / "roads.osm.xml", Survey()
    if path.name.endswith(".pbf"):
        _read_pbf(path, roads, survey)
    elif path.name.endswith(_FORMATS):
        plain = path if path.suffix in (".osm", ".xml") else _unpacked(path, folder)
        _read_xml(plain, roads, survey, path)
    else:
        raise InputError(path, "not known as an OpenStreetMap extract", _MEND)
    if not survey.roads:
        raise InputError(path, "no way with a road class (highway) in it", "extract more")
    return roads, survey


def _is_restriction(tags: dict[str, str]) -> bool:
    return tags.get("type", "").startswith("restriction")


def _unpacked(path: Path, folder: Path) -> Path:
    plain = folder / "extract.osm.xml"
    try:
        with _open(path) as packed, plain.open("wb") as file:
            while chunk := packed.read(_CHUNK_BYTES):
                file.write(chunk)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(path, f"damaged: {error}", "fetch it again") from None
    return plain


@contextmanager
def _open(path: Path) -> Iterator[BoundedReader]:
    if path.suffix != ".bz2":
        with open_unpacked(path, MAX_EXTRACT_BYTES) as file:
            yield file
        return
    with bz2.open(path) as unpacked:
        yield BoundedReader(cast(BinaryIO, unpacked), path, MAX_EXTRACT_BYTES)


def _read_xml(plain: Path, roads: Path, survey: Survey, source: Path) -> None:
    try:
        for element in _elements(plain, source):
            if element.tag == "relation":
                survey.add_relation(_tags(element))
            elif element.tag == "way":
                nodes = tuple(int(nd.get("ref", "0")) for nd in element.iter("nd"))
                survey.add_way(_number(element), _tags(element), nodes)
        wanted = {n for way in survey.roads.values() if not way.closed for n in way.nodes}
        with roads.open("wb") as file:
            file.write(b'<osm version="0.6">\n')
            for element in _elements(plain, source):
                if (
                    _number(element) in wanted
                    if element.tag == "node"
                    else survey.is_open(_number(element))
                    if element.tag == "way"
                    else _is_restriction(_tags(element))
                ):
                    file.write(ElementTree.tostring(element))
            file.write(b"</osm>\n")
    except OSError as error:
        raise InputError(source, error.strerror or "not readable", "check the path") from None
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(source, f"not OpenStreetMap's XML: {error}", _MEND) from None


def _elements(plain: Path, source: Path) -> Iterator[ElementTree.Element]:
    """Nodes, ways and relations; memory does not grow with the file."""
    root: ElementTree.Element | None = None
    with plain.open("rb") as file:
        for event, element in ElementTree.iterparse(file, events=("start", "end")):
            if root is None:
                root = element
                if root.tag != "osm":
                    raise InputError(source, f"a <{root.tag}>, no OpenStreetMap extract", _MEND)
            if event == "end" and element.tag in ("node", "way", "relation"):
                yield element
                root.clear()


def _tags(element: ElementTree.Element) -> dict[str, str]:
    return {tag.get("k", ""): tag.get("v", "") for tag in element.iter("tag")}


def _number(element: ElementTree.Element) -> int:
    return int(element.get("id", "0"))


def _read_pbf(path: Path, roads: Path, survey: Survey) -> None:
    import osmium

    on_roads = osmium.IdTracker()
    kinds = osmium.osm
    try:
        for way in osmium.FileProcessor(path, kinds.WAY):
            survey.add_way(way.id, dict(way.tags), tuple(node.ref for node in way.nodes))
            if survey.is_open(way.id):
                on_roads.add_references(way)
        nodes = on_roads.id_filter().enable_for(kinds.NODE)
        with osmium.SimpleWriter(roads) as writer:
            for thing in osmium.FileProcessor(path).with_filter(nodes):
                if thing.is_relation():
                    survey.add_relation(dict(thing.tags))
                    if not _is_restriction(dict(thing.tags)):
                        continue
                elif thing.is_way() and not survey.is_open(thing.id):
                    continue
                writer.add(thing)
    except (RuntimeError, ValueError) as error:
        raise InputError(path, f"damaged: {error}", "fetch it again") from None

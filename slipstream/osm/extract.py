"""Reads an OpenStreetMap extract, and writes its open roads as XML for netconvert.

netconvert opens a road to cars though `motor_vehicle` or `vehicle` is `no` and `access` is not, so
that closed roads are left out here.
"""

from __future__ import annotations

import bz2
import shutil
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, cast
from xml.etree import ElementTree

from slipstream.errors import InputError
from slipstream.files import check_file, open_unpacked

MAX_EXTRACT_BYTES: Final = 2_000_000_000
"""Of an extract."""
_FORMATS: Final = (".osm", ".osm.xml", ".osm.gz", ".osm.xml.gz", ".osm.bz2", ".osm.xml.bz2")
_MEND: Final = "give .osm or .osm.xml (also .gz, .bz2), or .osm.pbf"

Kind = Literal["node", "way", "relation"]


@dataclass(frozen=True)
class Thing:
    """A node, way or relation.

    Attributes:
        place: of a node, latitude and longitude in degrees.
        nodes: of a way.
        members: of a relation: kind, id and role.
    """

    kind: Kind
    id: int
    tags: Mapping[str, str]
    place: tuple[float, float] = (0.0, 0.0)
    nodes: tuple[int, ...] = ()
    members: tuple[tuple[str, int, str], ...] = ()

    def xml(self, added: Mapping[str, str]) -> bytes:
        """As netconvert reads it; tags that are added come first and hold."""
        values = {"id": str(self.id), "version": "1"}
        if self.kind == "node":
            values |= {"lat": repr(self.place[0]), "lon": repr(self.place[1])}
        element = ElementTree.Element(self.kind, values)
        for node in self.nodes:
            ElementTree.SubElement(element, "nd", ref=str(node))
        for kind, ref, role in self.members:
            ElementTree.SubElement(element, "member", type=kind, ref=str(ref), role=role)
        kept = {key: value for key, value in self.tags.items() if key not in added}
        for key, value in {**added, **kept}.items():
            ElementTree.SubElement(element, "tag", k=key, v=value)
        return ElementTree.tostring(element) + b"\n"


@dataclass(frozen=True)
class Extract:
    """An extract that can be read several times.

    Attributes:
        path: as it was given: errors name it.
        things: those of some kinds, of nodes only those with these ids.
    """

    path: Path
    things: Callable[[tuple[Kind, ...], Collection[int]], Iterator[Thing]]


def open_extract(path: Path, folder: Path) -> Extract:
    """Find out what a file is. A packed one is unpacked into the folder; a ``.osm.pbf`` needs the
    package osmium.

    Raises:
        InputError: there is no such file, its format is not known or it is damaged; the last also
            while its things are read.
        ModuleNotFoundError: osmium is not installed.
    """
    check_file(path, MAX_EXTRACT_BYTES, "give an OpenStreetMap extract")
    name = path.name.lower()
    if name.endswith(".pbf"):
        import osmium as osmium

        return Extract(path, lambda kinds, nodes: _pbf_things(path, kinds, nodes))
    if not name.endswith(_FORMATS):
        raise InputError(path, "not known as an OpenStreetMap extract", _MEND)
    plain = path if name.endswith((".osm", ".xml")) else _unpacked(path, folder)
    return Extract(path, lambda kinds, nodes: _xml_things(plain, path, kinds, nodes))


def write_roads(
    extract: Extract,
    roads: Path,
    wanted: Callable[[Thing], bool],
    nodes: Collection[int],
    added: Mapping[int, Mapping[str, str]],
) -> None:
    """Write part of an extract as XML.

    Args:
        wanted: whether a way or relation belongs to it.
        added: tags by way that hold instead of the extract's.

    Raises:
        InputError: the extract is damaged.
    """
    with roads.open("wb") as file:
        file.write(b'<osm version="0.6">\n')
        for thing in extract.things(("node", "way", "relation"), nodes):
            if thing.kind == "node" or wanted(thing):
                file.write(thing.xml(added.get(thing.id, {}) if thing.kind == "way" else {}))
        file.write(b"</osm>\n")


def _unpacked(path: Path, folder: Path) -> Path:
    plain = folder / "extract.osm.xml"
    try:
        with (
            bz2.open(path) if path.suffix.lower() == ".bz2" else open_unpacked(path) as packed,
            plain.open("wb") as file,
        ):
            shutil.copyfileobj(packed, file)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(path, f"damaged: {error}", "fetch it again") from None
    return plain


def _xml_things(
    plain: Path, source: Path, kinds: tuple[Kind, ...], nodes: Collection[int]
) -> Iterator[Thing]:
    try:
        for element in _elements(plain, source):
            kind, number = cast(Kind, element.tag), int(element.get("id", "0"))
            if kind not in kinds or (kind == "node" and number not in nodes):
                continue
            place = (0.0, 0.0)
            if kind == "node":
                place = float(element.get("lat", "")), float(element.get("lon", ""))
            yield Thing(
                kind,
                number,
                {tag.get("k", ""): tag.get("v", "") for tag in element.iter("tag")},
                place,
                tuple(int(nd.get("ref", "0")) for nd in element.iter("nd")),
                tuple(
                    (m.get("type", ""), int(m.get("ref", "0")), m.get("role", ""))
                    for m in element.iter("member")
                ),
            )
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


def _pbf_things(path: Path, kinds: tuple[Kind, ...], nodes: Collection[int]) -> Iterator[Thing]:
    import osmium

    of = osmium.osm
    bits = {"node": of.NODE, "way": of.WAY, "relation": of.RELATION}
    try:
        for kind in kinds:
            # The format is told: osmium goes by the ending, in small letters alone.
            reader: Any = osmium.FileProcessor(osmium.io.File(str(path), "pbf"), bits[kind])
            if kind == "node":
                reader = reader.with_filter(osmium.filter.IdFilter(nodes))
            for thing in reader:
                yield _pbf_thing(kind, thing)
    except (RuntimeError, ValueError) as error:
        raise InputError(path, f"damaged: {error}", "fetch it again") from None


def _pbf_thing(kind: Kind, thing: Any) -> Thing:
    tags = dict(thing.tags)
    if kind == "node":
        return Thing(kind, thing.id, tags, place=(thing.location.lat, thing.location.lon))
    if kind == "way":
        return Thing(kind, thing.id, tags, nodes=tuple(node.ref for node in thing.nodes))
    names = {"n": "node", "w": "way", "r": "relation"}
    members = tuple((names[m.type], m.ref, m.role) for m in thing.members)
    return Thing(kind, thing.id, tags, members=members)

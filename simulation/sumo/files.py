"""A first look at SUMO files: for files of another kind SUMO's own words are no help."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path
from xml.etree import ElementTree

from slipstream.errors import InputError


def check_files(net: Path, others: tuple[Path, ...]) -> None:
    """Check that the net is a SUMO net, and that the other files are XML and none.

    Raises:
        InputError: a file cannot be read, is no XML, or is of the wrong kind.
    """
    if _root(net) != "net":
        raise InputError(net, "no SUMO net", "build one with netconvert")
    check_vehicle_files(others)


def check_vehicle_files(paths: tuple[Path, ...]) -> None:
    """Check that files are XML and no nets.

    Raises:
        InputError: one is not.
    """
    for path in paths:
        if _root(path) == "net":
            raise InputError(path, "a SUMO net where vehicles belong", "give a route file")


def _root(path: Path) -> str:
    """Name of a file's first element.

    Raises:
        InputError: the file cannot be read or is no XML.
    """
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            _, root = next(iter(ElementTree.iterparse(file, events=("start",))))
    except OSError as error:
        problem = error.strerror or str(error)
        raise InputError(path, f"not readable: {problem}", "check the path") from None
    except (ElementTree.ParseError, StopIteration, EOFError, zlib.error) as error:
        raise InputError(path, f"not XML: {error}", "give a SUMO file") from None
    return str(root.tag)

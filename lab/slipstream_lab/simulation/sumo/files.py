"""First checks of SUMO files: SUMO's own messages do not help with files of another kind."""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path
from xml.etree import ElementTree

from slipstream.errors import InputError
from slipstream.roads.sumo_files import elements


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


def check_no_include(element: ElementTree.Element, path: Path) -> None:
    """Check that an element brings no other file in: what that one names or writes is not seen.

    Raises:
        InputError: it does.
    """
    if element.tag == "include":
        key = element.get("href")
        mend = "give the included file itself, by --additional or --routes"
        raise InputError(path, "an <include>, which is not followed", mend, key=key)


def put_file(path: Path, text: str) -> None:
    """Write a file as a whole, or leave one with this text as it is: a running SUMO may read it."""
    data = text.encode()
    with contextlib.suppress(OSError):
        if path.read_bytes() == data:
            return
    new = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}")
    try:
        new.write_bytes(data)
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)


def _root(path: Path) -> str:
    """Name of a file's first element.

    Raises:
        InputError: the file cannot be read or is no XML.
    """
    # An XML file has one; what has none is refused by the parser.
    return str(next(elements(path, "start")).tag)

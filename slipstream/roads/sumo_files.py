"""First checks of SUMO files: SUMO's own messages do not help with files of another kind."""

from __future__ import annotations

import contextlib
import os
import threading
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal
from xml.etree import ElementTree

from slipstream.errors import InputError
from slipstream.files import open_unpacked

MAX_SUMO_BYTES: Final = 512_000_000
MAX_SUMO_ELEMENTS: Final = 2_000_000
"""Of a SUMO file, unpacked: some million vehicles."""


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


def elements(path: Path, event: Literal["start", "end"] = "end") -> Iterator[ElementTree.Element]:
    """Elements of a file, packed or not, each when it begins or ends.

    What stands in the root is dropped when it has ended: memory does not grow with the file.

    Raises:
        InputError: the file cannot be read, is no XML, too large, or ends in the middle.
    """
    depth, count, root = 0, 0, None
    try:
        with open_unpacked(path, MAX_SUMO_BYTES) as file:
            for kind, element in ElementTree.iterparse(file, events=("start", "end")):
                depth += 1 if kind == "start" else -1
                count += kind == "start"
                if count > MAX_SUMO_ELEMENTS:
                    problem = f"more than {MAX_SUMO_ELEMENTS} elements"
                    raise InputError(path, problem, "give a smaller file")
                root = element if root is None else root
                if kind == event:
                    yield element
                if kind == "end" and depth == 1:
                    root.clear()
    except OSError as error:
        problem = error.strerror or str(error)
        raise InputError(path, f"not readable: {problem}", "check the path") from None
    except (ElementTree.ParseError, EOFError, zlib.error) as error:
        raise InputError(path, f"not XML: {error}", "give a SUMO file") from None


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

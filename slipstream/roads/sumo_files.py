"""Elements of SUMO's XML files."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

from slipstream.errors import InputError
from slipstream.files import open_unpacked


def elements(path: Path, event: Literal["start", "end"] = "end") -> Iterator[ElementTree.Element]:
    """Elements of a file, packed or not, each when it begins or ends.

    What stands in the root is dropped when it has ended: memory does not grow with the file.

    Raises:
        InputError: the file cannot be read, is no XML, or ends in the middle.
    """
    depth, root = 0, None
    try:
        with open_unpacked(path) as file:
            for kind, element in ElementTree.iterparse(file, events=("start", "end")):
                depth += 1 if kind == "start" else -1
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

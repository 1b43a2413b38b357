"""Additional files of the user's, made fit to run: what they would write goes nowhere.

A detector's output file lies beside the additional file. Several arms at once would write it, over
what the user has there.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from slipstream.errors import InputError
from slipstream.files import open_unpacked
from slipstream_lab.simulation.sumo.files import check_no_include, put_file

_NOWHERE: Final = "NUL"
"""SUMO's name of a file that nothing is written to."""
_WRITES: Final = {
    **dict.fromkeys(
        (
            *("e1Detector", "inductionLoop", "instantInductionLoop"),
            *("e2Detector", "laneAreaDetector", "e3Detector", "entryExitDetector"),
            *("edgeData", "laneData", "meandata", "routeProbe", "vTypeProbe"),
        ),
        "file",
    ),
    "calibrator": "output",
    "timedEvent": "dest",
}
"""Attribute with the output file, by element."""
_READS: Final = {
    **dict.fromkeys(("variableSpeedSign", "rerouter"), "file"),
    "poly": "imgFile",
    "poi": "imgFile",
}
"""Attribute with an input file, relative to the additional file, by element."""


def without_output(paths: Sequence[Path], folder: Path) -> tuple[Path, ...]:
    """Files that do the same and write nothing: a copy in a folder for each that would. Raises
    InputError: one cannot be read, is no XML, or includes another file.
    """
    made = []
    for number, path in enumerate(paths):
        tree = _parse(path)
        for element in tree.iter():
            check_no_include(element, path)
        writing = [e for e in tree.iter() if _WRITES.get(e.tag) in e.attrib]
        if not writing:
            made.append(path)
            continue
        for element in writing:
            element.set(_WRITES[element.tag], _NOWHERE)
        for element in tree.iter():
            key = _READS.get(element.tag)
            if key is not None and key in element.attrib:
                element.set(key, str(path.absolute().parent / element.attrib[key]))
        name = path.name.removesuffix(".gz").removesuffix(".xml").removesuffix(".add")
        copy = folder / f"{number}-{name}.add.xml"
        folder.mkdir(parents=True, exist_ok=True)
        put_file(copy, ElementTree.tostring(tree, encoding="unicode"))
        made.append(copy)
    return tuple(made)


def _parse(path: Path) -> ElementTree.Element:
    try:
        with open_unpacked(path) as file:
            return ElementTree.parse(file).getroot()
    except (ElementTree.ParseError, EOFError, OSError, zlib.error) as error:
        raise InputError(path, f"not XML: {error}", "give a SUMO file") from None

"""What a user gives of a SUMO world: files one by one, or a SUMO configuration that names them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from slipstream.errors import InputError
from slipstream.roads.sumo_files import elements

_KEYS: Final = {
    **dict.fromkeys(("net-file", "net", "n"), "net"),
    **dict.fromkeys(("route-files", "routes", "r"), "routes"),
    **dict.fromkeys(("additional-files", "additional", "a"), "additional"),
    **dict.fromkeys(("begin", "b"), "begin"),
    **dict.fromkeys(("end", "e"), "end"),
}
"""SUMO's names of the options that are taken, with their synonyms."""
_SILENT: Final = frozenset(
    {"output", "report", "gui_only", "time", "traci_server", "random_number"}
)
"""Sections whose other options do not change what drives."""
_UNITS_S: Final = (1.0, 60.0, 3600.0, 86400.0)


@dataclass(frozen=True)
class SumoFiles:
    """A SUMO world of the user's.

    Attributes:
        routes: its traffic; none: the scenario's demand.
        begin_s: when its traffic begins; None: not said.
    """

    net: Path | None = None
    routes: tuple[Path, ...] = ()
    additional: tuple[Path, ...] = ()
    begin_s: float | None = None
    end_s: float | None = None
    ignored: tuple[str, ...] = ()


def read_configuration(path: Path) -> SumoFiles:
    """Read a SUMO configuration (``.sumocfg``): net, routes, additional files, begin and end.

    Files stand relative to it.

    Raises:
        InputError: it cannot be read, is none, names no net or no routes, a file that does not
            exist, or a time that is none.
    """
    found: dict[str, str] = {}
    ignored: list[str] = []
    section, root = "", ""
    for element in elements(path, "start"):
        tag, value = element.tag, element.get("value", element.get("v"))
        root = root or tag
        if value is None:
            section = tag
        elif tag in _KEYS:
            found[_KEYS[tag]] = value
        elif section not in _SILENT:
            ignored.append(tag)
    if "configuration" not in root.lower():
        raise InputError(path, f"no SUMO configuration: a <{root}>", "give a .sumocfg file")
    for key, option in (("net", "net-file"), ("routes", "route-files")):
        if not found.get(key, "").strip():
            raise InputError(path, f"it names no {option}", "add it", key=option)
    net, *others = _files(path, "net-file", found["net"])
    if others:
        raise InputError(path, "more than one net", "give one", key="net-file")
    return SumoFiles(
        net,
        _files(path, "route-files", found["routes"]),
        _files(path, "additional-files", found.get("additional", "")),
        _time_s(path, "begin", found.get("begin")) or 0.0,
        _time_s(path, "end", found.get("end")),
        tuple(ignored),
    )


def _files(path: Path, key: str, text: str) -> tuple[Path, ...]:
    files = tuple(_file(path.parent, part.strip()) for part in text.split(",") if part.strip())
    for file in files:
        if not file.is_file():
            problem = f"it names {file.name!r}, which is not there"
            raise InputError(path, problem, "mend the name or add the file", key=key)
    return files


def _file(folder: Path, name: str) -> Path:
    """A file that a configuration names; SUMO writes blanks, commas and the like as %20, %2C."""
    decoded, literal = folder / unquote(name), folder / name
    return literal if literal.is_file() and not decoded.is_file() else decoded


def _time_s(path: Path, key: str, text: str | None) -> float | None:
    """Seconds, or days, hours, minutes and seconds with colons between; negative: not said."""
    if text is None:
        return None
    try:
        parts = [float(part) for part in reversed(text.split(":"))]
        seconds = sum(part * unit for part, unit in zip(parts, _UNITS_S, strict=False))
        if len(parts) <= len(_UNITS_S) and math.isfinite(seconds):
            return seconds if seconds >= 0 else None
    except ValueError:
        pass
    raise InputError(path, f"{text!r} is no time", "give seconds or HH:MM:SS", key=key)

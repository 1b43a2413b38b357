"""What readers of the published sets share: text, numbers, and an instance file's plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from slipstream.errors import InputError
from slipstream.files import read_text
from slipstream_lab.research.instances.matrices.schema import MAX_PLACES
from slipstream_lab.research.instances.schema import FORMAT

_MAX_BYTES: Final = 20_000_000


def set_text(path: Path) -> str:
    """The text of a file of bounded size."""
    return read_text(path, _MAX_BYTES)


def instance_data(
    name: str,
    depot: int,
    at: Mapping[int, Sequence[float]],
    demands: Mapping[int, int],
    windows: Mapping[int, tuple[float, float]] | None,
    services: Mapping[int, float] | None,
    vehicles: tuple[int, int],
    matrix: dict[str, Any],
    path: Path,
) -> dict[str, Any]:
    """Plain data of an instance file."""
    count, capacity = vehicles
    if not 1 <= count <= MAX_PLACES:
        raise InputError(path, f"{count} vehicles", f"give 1 to {MAX_PLACES}")
    stops = []
    for i in sorted(at):
        stop: dict[str, Any] = {"id": str(i), "node": str(i), "demand": demands[i]}
        stop["service_s"] = 0.0 if services is None else services[i]
        if windows is not None:
            stop |= {"earliest_s": windows[i][0], "latest_s": windows[i][1]}
        if i != depot:
            stops.append(stop)
    vehicle: dict[str, Any] = {"capacity": capacity}
    if windows is not None:
        vehicle |= {"ready_s": windows[depot][0], "return_by_s": windows[depot][1]}
    return {
        "format": FORMAT,
        "name": name[:200] or path.stem[:200],
        "provenance": f"imported from {path.name}"[:2000],
        "fleet": {
            "depots": [{"id": "depot", "node": str(depot)}],
            "stops": stops,
            "vehicles": [{"id": f"v{n}", **vehicle} for n in range(1, count + 1)],
        },
        "matrix": {
            "places": [{"id": str(i), "x_m": at[i][0], "y_m": at[i][1]} for i in sorted(at)],
            **matrix,
        },
    }


def number_in(word: str, path: Path, line: int, key: str = "") -> float:
    """A word of a line, or of a key, as a finite number."""
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        where = key or f"line {line}"
        raise InputError(path, f"{word!r} is not a number", "mend it", key=where)
    return value


def whole_of(word: str, path: Path, key: str) -> int:
    """A word as a whole number from 0 on."""
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    return whole_in(value, path, key)


def whole_in(value: float, path: Path, key: str) -> int:
    """A whole number from 0 on."""
    if not (math.isfinite(value) and value >= 0 and value == int(value)):
        raise InputError(path, f"{value:g} is not a whole number from 0 on", "mend it", key=key)
    return int(value)

"""Files in VRPLIB's format, that of CVRPLIB (http://vrp.galgos.inf.puc-rio.br), after TSPLIB 95."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from research.instances.matrices.schema import MAX_PLACES
from research.instances.matrices.set_files import instance_data, number_in, whole_in, whole_of
from slipstream.errors import InputError

_SPECIFICATIONS: Final = (
    *("NAME", "COMMENT", "TYPE", "DIMENSION", "CAPACITY", "VEHICLES"),
    *("EDGE_WEIGHT_TYPE", "EDGE_WEIGHT_FORMAT", "NODE_COORD_TYPE"),
)
_SECTIONS: Final = (
    *("NODE_COORD_SECTION", "DEMAND_SECTION", "DEPOT_SECTION", "EDGE_WEIGHT_SECTION"),
    *("TIME_WINDOW_SECTION", "SERVICE_TIME_SECTION"),
)

_Rows = list[tuple[int, list[float]]]
"""(line, its numbers)."""


def vrplib_data(text: str, path: Path, *, exact_vehicles: bool = False) -> dict[str, Any]:
    """Plain data of an instance file; distances are rounded to the nearest whole number.

    Args:
        exact_vehicles: the number in the name (-k4) is the most that are allowed, not about how
            many are needed.

    Raises:
        InputError: a line, section or specification is malformed, missing or not supported.
    """
    given, sections = _parts(text, path)
    kind = given.get("TYPE", "CVRP").upper()
    if kind not in ("CVRP", "VRPTW", "CVRPTW"):
        raise InputError(path, f"a problem of type {kind}", "give a CVRP or VRPTW", key="TYPE")
    size = whole_of(_spec(given, "DIMENSION", path), path, "DIMENSION")
    capacity = whole_of(_spec(given, "CAPACITY", path), path, "CAPACITY")
    if not 2 <= size <= MAX_PLACES:
        mend = f"give 2 to {MAX_PLACES} places"
        raise InputError(path, f"{size} places", mend, key="DIMENSION")
    demands = _column(sections, "DEMAND_SECTION", size, 1, path)
    coordinates = {}
    if "NODE_COORD_SECTION" in sections:
        coordinates = _column(sections, "NODE_COORD_SECTION", size, 2, path)
    depots = [
        int(n) for _, row in sections.get("DEPOT_SECTION", [(0, [1.0])]) for n in row if n > 0
    ]
    if len(depots) != 1 or depots[0] > size:
        raise InputError(path, "not one depot", "give its number, then -1", key="DEPOT_SECTION")
    windows = services = None
    if "TIME_WINDOW_SECTION" in sections:
        windows = _column(sections, "TIME_WINDOW_SECTION", size, 2, path)
    if "SERVICE_TIME_SECTION" in sections:
        services = _column(sections, "SERVICE_TIME_SECTION", size, 1, path)
    matrix: dict[str, Any] = {"speed_mps": 1.0} if windows or services else {}
    weights = _spec(given, "EDGE_WEIGHT_TYPE", path).upper()
    if weights == "EXPLICIT":
        matrix["distances_m"] = _explicit(given, sections, size, path)
    elif weights == "EUC_2D":
        if not coordinates:
            raise InputError(path, "no coordinates", "add them", key="NODE_COORD_SECTION")
        matrix["euclidean"] = "nearest"
    else:
        mend = "take EUC_2D or EXPLICIT"
        raise InputError(path, f"distances of type {weights}", mend, key="EDGE_WEIGHT_TYPE")
    places = range(1, size + 1)
    total = sum(whole_in(demands[i][0], path, "DEMAND_SECTION") for i in places)
    needed = max(1, math.ceil(total / max(1, capacity)))
    name = given.get("NAME") or path.stem
    if "VEHICLES" in given:
        count = whole_of(given["VEHICLES"], path, "VEHICLES")
    elif exact_vehicles:
        limit = re.search(r"-k(\d{1,4})(?:-|$)", name)
        if limit is None:
            mend = "end the name with -k and their number, or give VEHICLES"
            raise InputError(path, "no number of vehicles", mend, key="NAME")
        count = int(limit[1])
    else:
        of_name = name.rpartition("-k")[2]
        count = math.ceil(1.15 * max(needed, int(of_name) if of_name.isdecimal() else 0)) + 1
    return instance_data(
        name,
        depots[0],
        {i: tuple(coordinates[i]) if coordinates else (0.0, 0.0) for i in places},
        {i: int(demands[i][0]) for i in places},
        None if windows is None else {i: (windows[i][0], windows[i][1]) for i in places},
        None if services is None else {i: services[i][0] for i in places},
        (count, capacity),
        matrix,
        path,
    )


def _parts(text: str, path: Path) -> tuple[dict[str, str], dict[str, _Rows]]:
    """(specifications, numbers of each section)."""
    given: dict[str, str] = {}
    sections: dict[str, _Rows] = {}
    rows: _Rows | None = None
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        head = words[0].rstrip(":").upper()
        if head == "EOF":
            break
        if head.endswith("_SECTION"):
            if head not in _SECTIONS:
                mend = "give an instance without it"
                raise InputError(path, f"{head} is not supported", mend, key=f"line {number}")
            if head in sections:
                raise InputError(path, f"{head} twice", "remove one", key=f"line {number}")
            rows = sections[head] = []
        elif ":" in line:
            key, _, value = line.partition(":")
            key = key.strip().upper()
            if key not in _SPECIFICATIONS:
                mend = "give an instance without it"
                raise InputError(path, f"{key} is not supported", mend, key=f"line {number}")
            given[key] = value.strip().strip('"')
            rows = None
        elif rows is None:
            mend = "give a file in VRPLIB's format"
            raise InputError(path, f"{words[0]!r} outside a section", mend, key=f"line {number}")
        else:
            rows.append((number, [number_in(word, path, number) for word in words]))
    return given, sections


def _column(
    sections: Mapping[str, _Rows], name: str, size: int, width: int, path: Path
) -> dict[int, list[float]]:
    """Numbers by place, 1 to size, each of which has one row."""
    found: dict[int, list[float]] = {}
    for number, row in sections.get(name, []):
        if len(row) != width + 1:
            mend = f"give the place and {width} numbers"
            raise InputError(path, f"{len(row)} numbers", mend, key=f"line {number}")
        if row[0] not in range(1, size + 1) or row[0] in found:
            mend = f"give each place, 1 to {size}, once"
            raise InputError(path, f"place {row[0]:g} in {name}", mend, key=f"line {number}")
        found[int(row[0])] = row[1:]
    if len(found) != size:
        problem = f"{len(found)} rows, of {size} places"
        raise InputError(path, problem, "give a row for each place", key=name)
    return found


def _explicit(
    given: Mapping[str, str], sections: Mapping[str, _Rows], size: int, path: Path
) -> list[list[float]]:
    numbers = [n for _, row in sections.get("EDGE_WEIGHT_SECTION", []) for n in row]
    form = _spec(given, "EDGE_WEIGHT_FORMAT", path).upper()
    needed = {"FULL_MATRIX": size * size, "LOWER_ROW": size * (size - 1) // 2}
    if form not in needed:
        mend = f"take one of {', '.join(needed)}"
        raise InputError(path, f"format {form}", mend, key="EDGE_WEIGHT_FORMAT")
    if len(numbers) != needed[form]:
        problem = f"{len(numbers)} numbers, {form} of {size} places has {needed[form]}"
        raise InputError(path, problem, "mend the section", key="EDGE_WEIGHT_SECTION")
    if form == "FULL_MATRIX":
        return [numbers[i * size : (i + 1) * size] for i in range(size)]
    return [
        [
            0.0 if i == j else numbers[max(i, j) * (max(i, j) - 1) // 2 + min(i, j)]
            for j in range(size)
        ]
        for i in range(size)
    ]


def _spec(given: Mapping[str, str], key: str, path: Path) -> str:
    if not given.get(key):
        raise InputError(path, f"no {key}", "add it", key=key)
    return given[key]

"""Files in VRPLIB's format, that of CVRPLIB (http://vrp.galgos.inf.puc-rio.br), after TSPLIB 95."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from slipstream.errors import InputError
from slipstream_lab.research.instances.matrices.edge_weights import (
    FUNCTIONS,
    computed,
    coordinates_of,
    explicit,
    matrix_rows,
)
from slipstream_lab.research.instances.matrices.schema import MAX_PLACES
from slipstream_lab.research.instances.matrices.set_files import (
    instance_data,
    number_in,
    whole_in,
    whole_of,
)

_SPECIFICATIONS: Final = (
    *("NAME", "COMMENT", "TYPE", "DIMENSION", "CAPACITY", "VEHICLES", "DISTANCE", "SERVICE_TIME"),
    *("EDGE_WEIGHT_TYPE", "EDGE_WEIGHT_FORMAT", "NODE_COORD_TYPE", "DISPLAY_DATA_TYPE"),
)
_TYPES: Final = ("CVRP", "ACVRP", "DCVRP", "ADCVRP", "VRPTW", "CVRPTW")
_SECTIONS: Final = (
    *("NODE_COORD_SECTION", "DEMAND_SECTION", "DEPOT_SECTION", "EDGE_WEIGHT_SECTION"),
    *("TIME_WINDOW_SECTION", "SERVICE_TIME_SECTION", "DISPLAY_DATA_SECTION"),
)

_Rows = list[tuple[int, list[float]]]
"""(line, its numbers)."""


def vrplib_data(text: str, path: Path, *, exact_vehicles: bool = False) -> dict[str, Any]:
    """Plain data of an instance file; EUC_2D distances are rounded to the nearest whole number.

    DISTANCE limits the length of a route, service included: all drive one unit a unit of time.

    Args:
        exact_vehicles: the number in the name (-k4) is the most that are allowed, not about how
            many are needed.

    Raises:
        InputError: a line, section or specification is malformed, missing or not supported.
    """
    given, sections = _parts(text, path)
    kind = given.get("TYPE", "CVRP").upper()
    if kind not in _TYPES:
        mend = f"give one of {', '.join(_TYPES)}"
        raise InputError(path, f"a problem of type {kind}", mend, key="TYPE")
    _check_coordinates(given, path)
    size = whole_of(_spec(given, "DIMENSION", path), path, "DIMENSION")
    capacity = whole_of(_spec(given, "CAPACITY", path), path, "CAPACITY")
    if not 2 <= size <= MAX_PLACES:
        mend = f"give 2 to {MAX_PLACES} places"
        raise InputError(path, f"{size} places", mend, key="DIMENSION")
    demands = _column(sections, "DEMAND_SECTION", size, 1, path)
    coordinates = {}
    if "NODE_COORD_SECTION" in sections:
        coordinates = _column(sections, "NODE_COORD_SECTION", size, 2, path)
    depot = _depot(sections, size, path)
    if demands[depot][0]:
        problem = f"place {depot}, the depot, has a demand"
        raise InputError(path, problem, "make it 0", key="DEMAND_SECTION")
    windows = services = None
    if "TIME_WINDOW_SECTION" in sections:
        windows = _column(sections, "TIME_WINDOW_SECTION", size, 2, path)
    if "SERVICE_TIME_SECTION" in sections:
        services = _column(sections, "SERVICE_TIME_SECTION", size, 1, path)
    if "SERVICE_TIME" in given:
        if services is not None:
            problem = "given, and SERVICE_TIME_SECTION too"
            raise InputError(path, problem, "remove one", key="SERVICE_TIME")
        each = _positive_or_0(given["SERVICE_TIME"], path, "SERVICE_TIME")
        services = {i: [0.0 if i == depot else each] for i in range(1, size + 1)}
    longest = None
    if "DISTANCE" in given:
        longest = _positive_or_0(given["DISTANCE"], path, "DISTANCE")
        if windows is not None:
            problem = "a limit of length together with time windows"
            raise InputError(path, problem, "give an instance without one of them", key="DISTANCE")
    timed = windows is not None or services is not None or longest is not None
    matrix: dict[str, Any] = {"speed_mps": 1.0} if timed else {}
    weights = _spec(given, "EDGE_WEIGHT_TYPE", path).upper()
    if weights == "EXPLICIT":
        form = _spec(given, "EDGE_WEIGHT_FORMAT", path).upper()
        numbers = [n for _, row in sections.get("EDGE_WEIGHT_SECTION", []) for n in row]
        matrix["distances_m"] = matrix_rows(explicit(form, numbers, size, path))
    elif weights not in ("EUC_2D", *FUNCTIONS):
        mend = f"take one of EXPLICIT, EUC_2D, {', '.join(FUNCTIONS)}"
        raise InputError(path, f"distances of type {weights}", mend, key="EDGE_WEIGHT_TYPE")
    elif not coordinates:
        raise InputError(path, "no coordinates", "add them", key="NODE_COORD_SECTION")
    elif "EDGE_WEIGHT_SECTION" in sections:
        problem = f"a matrix, and distances of type {weights}"
        raise InputError(path, problem, "remove it, or take EXPLICIT", key="EDGE_WEIGHT_SECTION")
    elif weights == "EUC_2D":
        matrix["euclidean"] = "nearest"
    else:
        distances = computed(weights, coordinates_of(coordinates))
        matrix["distances_m"] = matrix_rows(distances)
        if weights == "GEO":  # latitudes and longitudes are no metres
            coordinates = {}
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
        if longest is not None:  # short routes need more vehicles than loads do
            count = min(size - 1, 2 * count)
    data = instance_data(
        name,
        depot,
        {i: tuple(coordinates[i]) if coordinates else (0.0, 0.0) for i in places},
        {i: int(demands[i][0]) for i in places},
        None if windows is None else {i: (windows[i][0], windows[i][1]) for i in places},
        None if services is None else {i: services[i][0] for i in places},
        (count, capacity),
        matrix,
        path,
    )
    if longest is not None:
        for vehicle in data["fleet"]["vehicles"]:
            vehicle["return_by_s"] = longest
    return data


def _check_coordinates(given: Mapping[str, str], path: Path) -> None:
    kind = given.get("NODE_COORD_TYPE", "TWOD_COORDS").upper()
    if kind not in ("TWOD_COORDS", "NO_COORDS"):
        problem, mend = f"coordinates of type {kind}", "take TWOD_COORDS or NO_COORDS"
        raise InputError(path, problem, mend, key="NODE_COORD_TYPE")


def _depot(sections: Mapping[str, _Rows], size: int, path: Path) -> int:
    """Number of the one depot."""
    numbers = [n for _, row in sections.get("DEPOT_SECTION", []) for n in row]
    if -1 in numbers:
        numbers = numbers[: numbers.index(-1)]
    if len(numbers) != 1 or numbers[0] not in range(1, size + 1):
        problem = f"{len(numbers)} depots" if len(numbers) != 1 else f"depot {numbers[0]:g}"
        raise InputError(
            path, problem, f"give one number, 1 to {size}, then -1", key="DEPOT_SECTION"
        )
    return int(numbers[0])


def _positive_or_0(word: str, path: Path, key: str) -> float:
    value = number_in(word, path, 0, key)
    if value < 0:
        raise InputError(path, f"{value:g} is below 0", "mend it", key=key)
    return value


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
            if key in given:
                raise InputError(path, f"{key} twice", "remove one", key=f"line {number}")
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


def _spec(given: Mapping[str, str], key: str, path: Path) -> str:
    if not given.get(key):
        raise InputError(path, f"no {key}", "add it", key=key)
    return given[key]

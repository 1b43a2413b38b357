"""Distances of VRPLIB's files, as TSPLIB 95 defines them: matrices in parts, and functions of
coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from dispatcher_daemon.planning.roads import Floats
from slipstream.errors import InputError

_EARTH_KM: Final = 6378.388
_PI: Final = 3.141592
"""Both as TSPLIB has them."""


def nearest(values: Floats) -> Floats:
    """To whole numbers, halves up: TSPLIB's nint."""
    return np.floor(values + 0.5)


def _ceil_2d(dx: Floats, dy: Floats) -> Floats:
    # A root that is whole may come out just above it.
    return np.ceil(np.hypot(dx, dy) - 1e-9)


def _floor_2d(dx: Floats, dy: Floats) -> Floats:
    return np.floor(np.hypot(dx, dy) + 1e-9)


def _man_2d(dx: Floats, dy: Floats) -> Floats:
    return nearest(np.abs(dx) + np.abs(dy))


def _max_2d(dx: Floats, dy: Floats) -> Floats:
    return np.maximum(nearest(np.abs(dx)), nearest(np.abs(dy)))


def _att(dx: Floats, dy: Floats) -> Floats:
    """Pseudo-Euclidean: a tenth of the squares, rounded up."""
    return np.ceil(np.sqrt((dx**2 + dy**2) / 10.0) - 1e-9)


_OF_DIFFERENCES: Final = {
    "CEIL_2D": _ceil_2d,
    "FLOOR_2D": _floor_2d,
    "MAN_2D": _man_2d,
    "MAX_2D": _max_2d,
    "ATT": _att,
}
FUNCTIONS: Final = (*_OF_DIFFERENCES, "GEO")
"""Names of distances that are computed of coordinates, besides EUC_2D."""


def computed(name: str, at: Floats) -> Floats:
    """Distances of one of `FUNCTIONS`, shape (n, n). `at`: coordinates, shape (n, 2); with GEO
    latitude and longitude as degrees.minutes.
    """
    if name == "GEO":
        found = _geo(at)
    else:
        found = _OF_DIFFERENCES[name](*(at[:, None] - at[None]).transpose(2, 0, 1))
    np.fill_diagonal(found, 0.0)
    return np.asarray(found)


def _geo(at: Floats) -> Floats:
    """Kilometres on TSPLIB's sphere, cut to whole ones after adding one."""
    degrees = np.trunc(at)
    latitude, longitude = (_PI * (degrees + 5.0 * (at - degrees) / 3.0) / 180.0).T
    q1 = np.cos(longitude[:, None] - longitude[None])
    q2 = np.cos(latitude[:, None] - latitude[None])
    q3 = np.cos(latitude[:, None] + latitude[None])
    angle = np.arccos(np.clip(0.5 * ((1.0 + q1) * q2 - (1.0 - q1) * q3), -1.0, 1.0))
    return np.asarray(np.floor(_EARTH_KM * angle + 1.0))


def _upper(size: int, diagonal: int) -> tuple[np.ndarray, np.ndarray]:
    return np.triu_indices(size, 1 - diagonal)


def _lower(size: int, diagonal: int) -> tuple[np.ndarray, np.ndarray]:
    return np.tril_indices(size, diagonal - 1)


_PARTS: Final = {
    "UPPER_ROW": (_upper, 0),
    "LOWER_ROW": (_lower, 0),
    "UPPER_DIAG_ROW": (_upper, 1),
    "LOWER_DIAG_ROW": (_lower, 1),
    # Of a symmetric matrix columns are the other half's rows.
    "UPPER_COL": (_lower, 0),
    "LOWER_COL": (_upper, 0),
    "UPPER_DIAG_COL": (_lower, 1),
    "LOWER_DIAG_COL": (_upper, 1),
}
FORMATS: Final = ("FULL_MATRIX", *_PARTS)


def explicit(form: str, numbers: list[float], size: int, path: Path) -> Floats:
    """The matrix of an EDGE_WEIGHT_SECTION, however its lines are broken, shape (n, n). Raises
    InputError: another format, or not as many numbers as it has.
    """
    if form not in FORMATS:
        mend = f"take one of {', '.join(FORMATS)}"
        raise InputError(path, f"format {form}", mend, key="EDGE_WEIGHT_FORMAT")
    full = form == "FULL_MATRIX"
    where = None if full else _PARTS[form][0](size, _PARTS[form][1])
    needed = size * size if where is None else len(where[0])
    if len(numbers) != needed:
        problem = f"{len(numbers)} numbers, {form} of {size} places has {needed}"
        raise InputError(path, problem, "mend the section", key="EDGE_WEIGHT_SECTION")
    if where is None:
        found = np.array(numbers).reshape(size, size)
    else:
        found = np.zeros((size, size))
        found[where] = numbers
        found.T[where] = numbers
    np.fill_diagonal(found, 0.0)
    return found


def matrix_rows(matrix: Floats) -> list[list[float]]:
    """As an instance file has them."""
    return [[float(value) for value in row] for row in matrix]


def coordinates_of(rows: Mapping[int, list[float]]) -> Floats:
    """Coordinates of places 1 to n, shape (n, 2)."""
    return np.array([rows[i] for i in sorted(rows)], dtype=np.float64)

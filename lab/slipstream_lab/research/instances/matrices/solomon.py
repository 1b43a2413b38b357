"""Solomon's files: customers with time windows on a plane, travelled at one unit of length a unit
of time. Distances are cut to tenths, as those of the best known solutions of exact methods are.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from slipstream.errors import InputError
from slipstream_lab.research.instances.matrices.schema import MAX_PLACES
from slipstream_lab.research.instances.matrices.set_files import (
    instance_data,
    number_in,
    whole_in,
    whole_of,
)

_COLUMNS: Final = 7


def solomon_data(text: str, path: Path) -> dict[str, Any]:
    """Plain data of an instance file. Raises InputError: a line is malformed or missing."""
    lines = [(n, line.split()) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    heads = [" ".join(words).upper() for _, words in lines[:6]]
    if len(lines) < 7 or heads[1] != "VEHICLE" or heads[4] != "CUSTOMER":
        mend = "give a file in Solomon's format: name, VEHICLE, CUSTOMER, rows"
        raise InputError(path, "not Solomon's format", mend)
    number, words = lines[3]
    if len(words) != 2:
        raise InputError(path, "not two numbers", "give NUMBER and CAPACITY", key=f"line {number}")
    count, capacity = (whole_of(word, path, f"line {number}") for word in words)
    rows: dict[int, list[float]] = {}
    for number, words in lines[6:]:
        row = [number_in(word, path, number) for word in words]
        if len(row) != _COLUMNS:
            mend = f"give {_COLUMNS}: number, x, y, demand, ready, due, service"
            raise InputError(path, f"{len(row)} numbers", mend, key=f"line {number}")
        if row[0] in rows or not row[0].is_integer():
            raise InputError(path, f"customer {row[0]:g} twice", "number on", key=f"line {number}")
        rows[int(row[0])] = row[1:]
    if min(rows) != 0 or len(rows) < 2 or len(rows) > MAX_PLACES:
        mend = f"give a depot 0 and 1 to {MAX_PLACES - 1} customers"
        raise InputError(path, f"{len(rows)} rows from {min(rows)} on", mend)
    return instance_data(
        " ".join(lines[0][1]),
        0,
        {i: (row[0], row[1]) for i, row in rows.items()},
        {i: whole_in(row[2], path, f"customer {i}") for i, row in rows.items()},
        {i: (row[3], row[4]) for i, row in rows.items()},
        {i: row[5] for i, row in rows.items()},
        (count, capacity),
        {"euclidean": "tenths", "speed_mps": 1.0},
        path,
    )

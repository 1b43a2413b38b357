"""Tables as files: CSV and Parquet, written in batches."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from slipstream.files import harmless_cell

if TYPE_CHECKING:
    from storage import TableColumn

Batches = Iterable[Sequence[Sequence[Any]]]
"""Rows with the columns' values, some at a time."""


def write_table(path: Path, columns: Sequence[TableColumn], batches: Batches) -> int:
    """Write a table; its file, whose ending says the form, appears once it is whole.

    Returns:
        Number of rows.
    """
    part = path.with_name(path.name + ".part")
    try:
        rows = _WRITERS[path.suffix](part, columns, batches)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return rows


def _write_csv(path: Path, columns: Sequence[TableColumn], batches: Batches) -> int:
    """CSV (RFC 4180) in UTF-8. Nothing stands for NULL; after a time comes the same in ISO 8601.
    No text is a formula.
    """
    count = 0
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(name for name, _ in _columns(columns))
        for rows in batches:
            writer.writerows([*_cells(columns, row)] for row in rows)
            count += len(rows)
    return count


def _cells(columns: Sequence[TableColumn], row: Sequence[Any]) -> Iterator[Any]:
    for column, value in zip(columns, row, strict=True):
        if column.kind == "boolean" and value is not None:
            yield "true" if value else "false"
        elif isinstance(value, str):
            yield harmless_cell(value)
        else:
            yield value
        if column.kind == "time":
            yield None if value is None else iso(value)


def _write_parquet(path: Path, columns: Sequence[TableColumn], batches: Batches) -> int:
    """Parquet; a time is followed by itself as a timestamp, which needs no ISO text."""
    import pyarrow
    from pyarrow import parquet

    types = {
        "integer": pyarrow.int64(),
        "real": pyarrow.float64(),
        "boolean": pyarrow.bool_(),
        "text": pyarrow.string(),
        "json": pyarrow.string(),
        "time": pyarrow.int64(),
        "moment": pyarrow.timestamp("ns", tz="UTC"),
    }
    schema = pyarrow.schema([(name, types[kind]) for name, kind in _columns(columns)])
    sources = [k for k, c in enumerate(columns) for _ in range(1 + (c.kind == "time"))]
    count = 0
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for rows in batches:
            by_column = list(zip(*rows, strict=True))
            arrays = [
                pyarrow.array(by_column[place], type=field.type)
                for place, field in zip(sources, schema, strict=True)
            ]
            writer.write_table(pyarrow.Table.from_arrays(arrays, schema=schema))
            count += len(rows)
    return count


def _columns(columns: Sequence[TableColumn]) -> Iterator[tuple[str, str]]:
    """Names and kinds of a file's columns: a time's is followed by that of its moment."""
    for column in columns:
        yield column.name, column.kind
        if column.kind == "time":
            yield f"{column.name.removesuffix('_ns')}_utc", "moment"


_WRITERS: Final[Mapping[str, Callable[[Path, Sequence[TableColumn], Batches], int]]] = {
    ".csv": _write_csv,
    ".parquet": _write_parquet,
}
FORMATS: Final = tuple(suffix.removeprefix(".") for suffix in _WRITERS)


def iso(time_ns: int) -> str:
    """A time, UTC, in ISO 8601 with nanoseconds."""
    whole = datetime.fromtimestamp(time_ns // 10**9, UTC)
    return f"{whole:%Y-%m-%dT%H:%M:%S}.{time_ns % 10**9:09d}Z"

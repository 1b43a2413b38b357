"""Tables as files: CSV and Parquet, written in batches."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Protocol, Self

if TYPE_CHECKING:
    from storage import TableColumn

Rows = Sequence[Sequence[Any]]


class ExportWriter(Protocol):
    """Writes one table."""

    def write(self, rows: Rows) -> None:
        """Write some rows."""
        ...

    def close(self) -> None:
        """Write what is left and close the file."""
        ...


class TableFile:
    """A table's file, which appears under its name once it is whole; a context manager.

    Args:
        path: the file; its ending says which form it has.
    """

    def __init__(self, path: Path, columns: Sequence[TableColumn]) -> None:
        self._path = path
        self._part = path.with_name(path.name + ".part")
        self._writer: ExportWriter = _WRITERS[path.suffix](self._part, columns)
        self.rows = 0

    def write(self, rows: Rows) -> None:
        """Write some rows, each with the columns' values."""
        self._writer.write(rows)
        self.rows += len(rows)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self._writer.close()
            self._part.replace(self._path)
            return
        with suppress(Exception):  # What went wrong is on its way already.
            self._writer.close()
        self._part.unlink(missing_ok=True)


class CsvWriter:
    """CSV (RFC 4180) in UTF-8. Nothing stands for NULL; after a time comes the same in ISO 8601."""

    def __init__(self, path: Path, columns: Sequence[TableColumn]) -> None:
        self._file = path.open("w", encoding="utf-8", newline="")
        self._kinds = [column.kind for column in columns]
        self._csv = csv.writer(self._file)
        header = []
        for column in columns:
            header.append(column.name)
            if column.kind == "time":
                header.append(iso_name(column.name))
        self._csv.writerow(header)

    def write(self, rows: Rows) -> None:
        """Write some rows."""
        self._csv.writerows(map(self._cells, rows))

    def _cells(self, row: Sequence[Any]) -> list[Any]:
        cells: list[Any] = []
        for kind, value in zip(self._kinds, row, strict=True):
            if kind == "boolean" and value is not None:
                value = "true" if value else "false"
            cells.append(value)
            if kind == "time":
                cells.append(None if value is None else iso(value))
        return cells

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class ParquetWriter:
    """Parquet; a time is followed by itself as a timestamp, which needs no ISO text."""

    def __init__(self, path: Path, columns: Sequence[TableColumn]) -> None:
        import pyarrow
        from pyarrow import parquet

        self._arrow = pyarrow
        types = {
            "integer": pyarrow.int64(),
            "real": pyarrow.float64(),
            "boolean": pyarrow.bool_(),
            "text": pyarrow.string(),
            "json": pyarrow.string(),
            "time": pyarrow.int64(),
        }
        fields = []
        self._sources: list[int] = []
        for place, column in enumerate(columns):
            fields.append(pyarrow.field(column.name, types[column.kind]))
            self._sources.append(place)
            if column.kind == "time":
                moment = pyarrow.timestamp("ns", tz="UTC")
                fields.append(pyarrow.field(iso_name(column.name), moment))
                self._sources.append(place)
        self._schema = pyarrow.schema(fields)
        self._writer = parquet.ParquetWriter(path, self._schema, compression="zstd")

    def write(self, rows: Rows) -> None:
        """Write some rows as one row group."""
        by_column = list(zip(*rows, strict=True))
        arrays = [
            self._arrow.array(by_column[place], type=field.type)
            for place, field in zip(self._sources, self._schema, strict=True)
        ]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> None:
        """Write the footer."""
        self._writer.close()


_WRITERS: Final[Mapping[str, Callable[[Path, Sequence[TableColumn]], ExportWriter]]] = {
    ".csv": CsvWriter,
    ".parquet": ParquetWriter,
}
FORMATS: Final = tuple(suffix.removeprefix(".") for suffix in _WRITERS)


def iso_name(name: str) -> str:
    """Name of the column with the time of a column in nanoseconds."""
    return f"{name.removesuffix('_ns')}_utc"


def iso(time_ns: int) -> str:
    """A time in ISO 8601, with nanoseconds."""
    whole = datetime.fromtimestamp(time_ns // 10**9, UTC)
    return f"{whole:%Y-%m-%dT%H:%M:%S}.{time_ns % 10**9:09d}Z"

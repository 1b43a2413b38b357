"""The page's tables as CSV, for spreadsheets; pure."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final, Literal

from slipstream.files import harmless_cell

Kind = Literal["plain", "time", "list"]


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        field: of a row; `id` is the row's key.
        header: in the file, with the unit.
        kind: a time is milliseconds in the row and ISO 8601 in UTC in the file; a list is joined.
    """

    field: str
    header: str
    kind: Kind = "plain"


def _columns(text: str) -> tuple[Column, ...]:
    """Columns from words `field`, `field=header`, with `@` before a time and `*` before a list."""
    found = []
    for word in text.split():
        kind: Kind = "time" if word[0] == "@" else "list" if word[0] == "*" else "plain"
        name, _, header = word.lstrip("@*").partition("=")
        found.append(Column(name, header or name, kind))
    return tuple(found)


TABLES: Final[Mapping[str, tuple[Column, ...]]] = {
    "vehicles": _columns(
        "id=vehicle level state text=doing @seen=silent_since road platoon place "
        "*with next=next_stop @eta delay_s stops_left carrier cycle x=x_m y=y_m "
        "heading=heading_deg source=position kwh saved_kwh km platoon_km charge_kwh"
    ),
    "roads": _columns(
        "id=road level flag why kmh cv=speed_cv vehicles gate gate_why rsu stopped @since"
    ),
    "rsus": _columns(
        "id=rsu level status why fps latency_ms skipped_share *faults *segments=roads vehicles "
        "@seen x=x_m y=y_m"
    ),
    "orders": _columns(
        "id=order level state vehicle node @eta @earliest @latest late_s "
        "@late_since @silent_since pinned source why @since x=x_m y=y_m"
    ),
    "cycles": _columns(
        "id=cycle @t=started level status why wall_s plans solver variables saved_kwh saved_share "
        "platoon_km unserved"
    ),
    "alarms": _columns(
        "id=alarm severity subject text mend @since @ended by=acknowledged_by @acknowledged"
    ),
    "energy": _columns(
        "@t=begin baseline baseline_kwh plan_kwh saved_kwh saved_share distance_kwh drag_kwh "
        "acceleration_kwh km platoon_km co2_kg money"
    ),
}
"""Columns of each table, in the order of the page's."""

_ROWS_A_PART: Final = 500


def csv_parts(table: str, rows: Iterable[tuple[str, Mapping[str, Any]]]) -> Iterator[bytes]:
    """A table as CSV with a header, UTF-8, in parts."""
    columns = TABLES[table]
    buffer = io.StringIO()
    writer = csv.writer(buffer)
    writer.writerow([column.header for column in columns])
    for number, (name, row) in enumerate(rows, 1):
        writer.writerow([_cell(column, name, row) for column in columns])
        if number % _ROWS_A_PART == 0:
            yield _taken(buffer)
    yield _taken(buffer)


def _taken(buffer: io.StringIO) -> bytes:
    text = buffer.getvalue()
    buffer.seek(0)
    buffer.truncate()
    # A name from the wire may hold half of a surrogate pair.
    return text.encode("utf-8", "replace")


def _cell(column: Column, name: str, row: Mapping[str, Any]) -> str | float | None:
    value: Any = name if column.field == "id" else row.get(column.field)
    if value is None:
        return None
    if column.kind == "time":
        return datetime.fromtimestamp(round(value / 1e3), UTC).isoformat(timespec="seconds")
    if column.kind == "list":
        return harmless_cell("; ".join(map(str, value)))
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, int | float) else harmless_cell(str(value))


def sorted_rows(table: Mapping[str, Mapping[str, Any]]) -> Sequence[tuple[str, Mapping[str, Any]]]:
    """Rows by name, numbers by their value."""
    return sorted(table.items(), key=lambda item: (_number(item[0]), item[0]))


def _number(name: str) -> int:
    return int(name) if name.isascii() and name.isdecimal() and len(name) < 19 else -1

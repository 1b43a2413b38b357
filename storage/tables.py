"""Rows of any table as they are stored, for a time range, in batches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Connection,
    Double,
    Table,
    Text,
    cast,
    select,
)

from slipstream.errors import InputError
from storage.models import Base, CycleRow

BATCH: Final = 5_000
"""Rows that are held in memory at once: some 10 MB of plans."""
_TIMES: Final = ("started_ns", "time_ns", "submitted_ns", "since_ns")
"""What a row's time is, in a table whose rows belong to no cycle."""

Kind = Literal["integer", "real", "boolean", "text", "json", "time"]


@dataclass(frozen=True)
class TableColumn:
    """A column.

    Attributes:
        name: its name.
        kind: time is UTC ns, json is text.
    """

    name: str
    kind: Kind


def table_names() -> tuple[str, ...]:
    """All tables, by name."""
    return tuple(sorted(Base.metadata.tables))


class Tables:
    """The tables of a database in one read transaction."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def columns(self, table: str) -> tuple[TableColumn, ...]:
        """The columns of a table, in the order of its rows' values.

        Raises:
            InputError: there is no such table.
        """
        return tuple(TableColumn(column.name, _kind(column)) for column in _table(table).columns)

    def rows(
        self,
        table: str,
        from_ns: int | None = None,
        to_ns: int | None = None,
        batch: int = BATCH,
    ) -> Iterator[Sequence[Sequence[Any]]]:
        """The rows of a table in the order of its primary key, `batch` at a time.

        Those of a cycle count by its start, others by their own time; a table without times is
        given whole.

        Args:
            table: its name.
            from_ns: UTC; rows before it are left out.
            to_ns: UTC; rows from it on are left out.
            batch: rows at once.

        Raises:
            InputError: there is no such table.
        """
        wanted = _table(table)
        query = select(
            *(
                cast(column, Text).label(column.name) if _kind(column) == "json" else column
                for column in wanted.columns
            )
        ).order_by(*wanted.primary_key.columns)
        condition = _between(wanted, from_ns, to_ns)
        if condition is not None:
            query = query.where(condition)
        options = {"yield_per": batch}
        with self._connection.execute(query, execution_options=options) as found:
            yield from found.partitions()


def _table(name: str) -> Table:
    table = Base.metadata.tables.get(name)
    if table is None:
        raise InputError("export", f"no table {name!r}", f"use one of: {', '.join(table_names())}")
    return table


def _between(table: Table, from_ns: int | None, to_ns: int | None) -> ColumnElement[bool] | None:
    cycles = Base.metadata.tables[CycleRow.__tablename__]
    of_cycle = [key.parent for key in table.foreign_keys if key.column is cycles.c.cycle]
    own = [table.columns[name] for name in _TIMES if name in table.columns]
    if from_ns is None and to_ns is None:
        return None
    if of_cycle:
        within = select(cycles.c.cycle).where(*_bounds(cycles.c.started_ns, from_ns, to_ns))
        return of_cycle[0].in_(within)
    if not own:
        return None
    condition, *more = _bounds(own[0], from_ns, to_ns)
    for each in more:
        condition = condition & each
    return condition


def _bounds(
    column: Column[Any], from_ns: int | None, to_ns: int | None
) -> list[ColumnElement[bool]]:
    bounds = [] if from_ns is None else [column >= from_ns]
    return bounds if to_ns is None else [*bounds, column < to_ns]


def _kind(column: Column[Any]) -> Kind:
    if isinstance(column.type, JSON):
        return "json"
    if isinstance(column.type, Boolean):
        return "boolean"
    if isinstance(column.type, Double):
        return "real"
    if isinstance(column.type, BigInteger):
        return "time" if column.name.endswith("_ns") else "integer"
    return "text"

"""Rows of any table as they are stored, for a time range, in batches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import msgspec
from sqlalchemy import (
    JSON,
    REAL,
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Connection,
    Double,
    LargeBinary,
    MetaData,
    SmallInteger,
    Table,
    Text,
    cast,
    select,
)
from sqlalchemy.orm import Session

from slipstream.errors import InputError
from storage.models import Base, CycleRow
from storage.traffic import recent
from storage.traffic.models import cycle_traffic

BATCH: Final = 5_000
"""Rows that are held in memory at once: some 10 MB of plans."""
_TIMES: Final = ("hour_ns", "started_ns", "began_ns", "time_ns", "submitted_ns", "since_ns")
"""What a row's time is, in a table whose rows belong to no cycle."""

_RECENT: Final = {
    "gates": Table(
        "gates",
        MetaData(),
        *(Column(name, BigInteger) for name in ("cycle", "position")),
        Column("segment", Text),
        Column("y_e", BigInteger),
        Column("reason", Text),
        *(Column(name, Double) for name in ("age_s", "speed_mps")),
        Column("open", Boolean),
    ),
    "segment_states": Table(
        "segment_states",
        MetaData(),
        Column("cycle", BigInteger),
        *(Column(name, Text) for name in ("segment", "rsu")),
        *(Column(name, BigInteger) for name in ("sequence", "time_ns")),
        Column("window_s", Double),
        Column("y_e", BigInteger),
        Column("reason", Text),
        *(Column(name, BigInteger) for name in ("vehicles", "frames")),
        Column("coverage", Double),
        Column("features", JSON),
    ),
}
"""What is read of `cycle_traffic` in place of its compressed rows, as tables of their own."""

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
    """The tables that can be read, by name: all but those of compressed parts."""
    stored = {name for name, table in Base.metadata.tables.items() if _is_plain(table)}
    return tuple(sorted(stored | _RECENT.keys()))


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
            from_ns: UTC; rows before it are left out.
            to_ns: UTC; rows from it on are left out.

        Raises:
            InputError: there is no such table.
        """
        wanted = _table(table)
        if table in _RECENT:
            yield from self._recent(table, from_ns, to_ns)
            return
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

    def _recent(
        self, table: str, from_ns: int | None, to_ns: int | None
    ) -> Iterator[Sequence[Sequence[Any]]]:
        """Gates or states of recent cycles, a cycle at a time."""
        query = select(cycle_traffic.c.cycle).order_by(cycle_traffic.c.cycle)
        condition = _between(cycle_traffic, from_ns, to_ns)
        if condition is not None:
            query = query.where(condition)
        names = [column.name for column in _table(table).columns]
        with Session(self._connection) as session:
            for cycle in self._connection.execute(query).scalars().all():
                rows = [[row[name] for name in names] for row in _expanded(session, table, cycle)]
                if rows:
                    yield rows


def _expanded(session: Session, table: str, cycle: int) -> Iterator[dict[str, Any]]:
    if table == "gates":
        for position, gate in enumerate(recent.gates(session, cycle, cycle).get(cycle, ())):
            yield {**gate.model_dump(), "cycle": cycle, "position": position}
        return
    for state in recent.states(session, cycle):
        features = None if state.features is None else msgspec.json.encode(state.features).decode()
        yield {**msgspec.structs.asdict(state), "cycle": cycle, "features": features}


def _is_plain(table: Table) -> bool:
    return not any(isinstance(column.type, LargeBinary) for column in table.columns)


def _table(name: str) -> Table:
    table = _RECENT.get(name, Base.metadata.tables.get(name))
    if table is None or not _is_plain(table):
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
    if isinstance(column.type, Double | REAL):
        return "real"
    if isinstance(column.type, BigInteger | SmallInteger):
        return "time" if column.name.endswith("_ns") else "integer"
    return "text"

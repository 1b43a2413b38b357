"""Statements for many rows: sums that grow, and values some at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final, TypeVar

from sqlalchemy import Table
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_T = TypeVar("_T")
_MAX_VALUES: Final = 500
"""Values in one statement; SQLite takes 32,766."""


def chunks(values: Sequence[_T]) -> Iterator[Sequence[_T]]:
    """Values for several statements."""
    for begin in range(0, len(values), _MAX_VALUES):
        yield values[begin : begin + _MAX_VALUES]


def insert_into(session: Session, table: Table) -> Any:
    """An INSERT of the session's kind of database, which can say what to do with known keys."""
    assert session.bind is not None
    dialect = postgresql if session.bind.dialect.name == "postgresql" else sqlite
    return dialect.insert(table)


def add_sums(session: Session, table: Table, parts: Iterable[DataclassInstance]) -> None:
    """Add parts to the rows of their keys, in one statement for all; the first one makes the row.

    Args:
        table: its columns are the fields of a part; all beside the primary key are sums.
    """
    rows = [asdict(part) for part in parts]
    if not rows:
        return
    statement = insert_into(session, table)
    key = list(table.primary_key.columns)
    summed = {c.name: c + statement.excluded[c.name] for c in table.columns if c not in set(key)}
    session.execute(statement.on_conflict_do_update(index_elements=key, set_=summed), rows)

"""Rows are at the level of what is told of their subjects: none is green behind its alarm; pure."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from dashboard.view.troubles import Trouble
from dashboard.web.tables.rows import Row, Rows

_RANK: Final = {"bad": 0, "warn": 1, "ok": 2, "idle": 3}
_TABLES: Final = {"vehicle": "vehicles", "road": "roads", "rsu": "rsus", "order": "orders"}
"""Tables of the kinds of subjects that have rows with a level."""

Worst = dict[str, dict[str, tuple[str, str]]]
"""Level and text of the worst that is told of a row, by table and row."""


def worst_by_row(told: Iterable[Trouble]) -> Worst:
    """The worst that is told of each subject; of several equally bad ones the first."""
    worst: Worst = {}
    for one in told:
        kind, _, name = one.subject.partition("/")
        rows = worst.setdefault(_TABLES.get(kind, ""), {})
        known = rows.get(name)
        if known is None or _RANK[one.level] < _RANK[known[0]]:
            rows[name] = one.level, one.text
    return worst


def raised(table: Rows, worst: dict[str, tuple[str, str]] | None) -> Rows:
    """The rows of a table, those that something is told of at its level at least."""
    found = {name: told for name, told in (worst or {}).items() if name in table}
    if not any(_RANK[level] < _RANK[table[name]["level"]] for name, (level, _) in found.items()):
        return table
    return table | {name: raised_row(table[name], *told) for name, told in found.items()}


def raised_row(row: Row, level: str, text: str) -> Row:
    """A row at this level at least, with the reason where its table has one and it has none."""
    if _RANK[level] >= _RANK[row["level"]]:
        return row
    why = {"why": row["why"] or text} if "why" in row else {}
    return {**row, "level": level, **why}

"""docs/operations.md says of every kind of alarm what it means and what to do."""

from __future__ import annotations

import re
from pathlib import Path

from dispatcher_daemon.service.alarms import KINDS

PAGE = (Path(__file__).parents[2] / "docs" / "operations.md").read_text()


def test_each_kind_has_its_row() -> None:
    """With the severity that it has, and no row of a kind that is gone."""
    section = PAGE.partition("\n## Alarms\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| `([a-z_]+)` \| ([a-z]+)", section, re.MULTILINE)
    assert dict(rows) == {name: kind.severity for name, kind in KINDS.items()}
    assert len(rows) == len(KINDS)

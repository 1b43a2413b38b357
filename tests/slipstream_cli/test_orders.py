"""`slipstream orders list`: what the database says of orders."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slipstream.orders import FleetRecords, OrderChange, OrderRecord
from slipstream_cli.main import main
from storage import open_database

NOW_NS = 1_790_000_000_000_000_000


@pytest.fixture
def url(tmp_path: Path) -> str:
    """A database with an open and a served order."""
    url = f"sqlite:///{tmp_path / 'a.db'}"
    served = OrderRecord(
        "s1", "n", 60.0, 1, None, None, "served", NOW_NS, "served by van-a", "van-a", 3
    )
    waiting = OrderRecord("s2", "n", 60.0, 1, None, None, "open", NOW_NS + 1, "new")
    changes = (
        OrderChange("s1", NOW_NS - 10**9, "planned", "in the plan of cycle 3", "van-a", 3),
        OrderChange("s1", NOW_NS, "served", "served by van-a", "van-a", 3),
    )
    with open_database(url) as database:
        database.save_fleet(FleetRecords((served, waiting), changes))
    return url


def test_orders_are_listed(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    """All of them, those in a state, or the life of one; as lines or as JSON."""
    assert main(["orders", "list", "--database", url]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "2026-09-21T14:13:20Z  served     s1  served by van-a",
        "2026-09-21T14:13:20Z  open       s2  new",
    ]
    assert main(["orders", "list", "--url", url, "--json", "--state", "open"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["order"], row["state"], row["vehicle"]) == ("s2", "open", None)
    assert main(["orders", "list", "s1", "--url", url, "--json"]) == 0
    life = json.loads(capsys.readouterr().out)
    assert [change["state"] for change in life] == ["planned", "served"]


def test_what_is_not_there_is_one_line(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An unknown order, and a mistyped database, which is not made."""
    assert main(["orders", "list", "s9", "--url", url]) == 2
    assert "no order 's9'" in capsys.readouterr().err
    other = tmp_path / "b.db"
    assert main(["orders", "list", "--url", f"sqlite:///{other}"]) == 2
    assert "no database there" in capsys.readouterr().err
    assert not other.exists()

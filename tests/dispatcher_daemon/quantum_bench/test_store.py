from __future__ import annotations

from pathlib import Path

import pytest

from dispatcher_daemon.quantum_bench.store import Store
from slipstream.errors import InputError


def test_a_later_run_goes_on_from_what_is_there(tmp_path: Path) -> None:
    """Results survive the process; those of other settings are not taken for them."""
    path = tmp_path / "deep" / "results.jsonl"
    Store(path, {"shots": 5}).put("row", "one", {"p_feasible": 0.5})
    again = Store(path, {"shots": 5})
    record = again.get("row", "one")
    assert record is not None
    assert record["p_feasible"] == 0.5
    assert again.get("row", "two") is None
    other = Store(path, {"shots": 6})
    assert other.get("row", "one") is None
    other.put("row", "one", {"p_feasible": 0.7})
    both = [Store(path, {"shots": shots}).get("row", "one") for shots in (5, 6)]
    assert [record and record["p_feasible"] for record in both] == [0.5, 0.7]


def test_a_line_that_was_cut_short_is_measured_again(tmp_path: Path) -> None:
    """A run that was killed while writing leaves half a line; the next one writes after it."""
    path = tmp_path / "results.jsonl"
    Store(path, {}).put("a", "one", {"x": 1})
    with path.open("a") as file:
        file.write('{"row": "b", "inst')
    store = Store(path, {})
    assert store.get("b", "one") is None
    store.put("b", "one", {"x": 2})
    again = Store(path, {})
    assert [(again.get(row, "one") or {}).get("x") for row in ("a", "b")] == [1, 2]


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    """The user's mistake, in one line."""
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--out"):
        Store(tmp_path / "file" / "results.jsonl", {})

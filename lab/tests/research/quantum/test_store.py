from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from slipstream.errors import InputError
from slipstream_lab.research.quantum.store import Store


def test_a_later_run_goes_on_from_what_is_there(tmp_path: Path) -> None:
    """Results survive the process; those of other settings are not taken for them."""
    path = tmp_path / "deep" / "results.jsonl"
    with Store(path, {"shots": 5}) as store:
        store.put("row", "one", {"p_feasible": 0.5})
    with Store(path, {"shots": 5}) as again:
        record = again.get("row", "one")
        assert record is not None
        assert record["p_feasible"] == 0.5
        assert again.get("row", "two") is None
    with Store(path, {"shots": 6}) as other:
        assert other.get("row", "one") is None
        other.put("row", "one", {"p_feasible": 0.7})
    both = [Store(path, {"shots": n}, read_only=True).get("row", "one") for n in (5, 6)]
    assert [record and record["p_feasible"] for record in both] == [0.5, 0.7]


def test_a_last_line_that_was_cut_short_is_dropped_and_measured_again(tmp_path: Path) -> None:
    """A run that was killed while writing leaves half a line, and no damage behind it."""
    path = tmp_path / "results.jsonl"
    with Store(path, {}) as store:
        store.put("a", "one", {"x": 1})
    with path.open("a") as file:
        file.write('{"row": "b", "inst')
    assert Store(path, {}, read_only=True).get("a", "one") is not None
    with Store(path, {}) as store:
        assert store.get("b", "one") is None
        store.put("b", "one", {"x": 2})
    again = Store(path, {}, read_only=True)
    assert [(again.get(row, "one") or {}).get("x") for row in ("a", "b")] == [1, 2]
    assert path.read_bytes().count(b"\n") == 2


@pytest.mark.parametrize("line", [b'{"row": "b", "inst', b"7", b'{"row": "b"}', b"\xff\x00"])
@pytest.mark.parametrize("read_only", [False, True])
def test_a_damaged_line_is_named_and_nothing_is_written(
    tmp_path: Path, line: bytes, read_only: bool
) -> None:
    """What is no record is not passed over: the line's number is told, the file left as it is."""
    path = tmp_path / "results.jsonl"
    with Store(path, {}) as store:
        store.put("a", "one", {"x": 1})
    whole = path.read_bytes()
    path.write_bytes(whole + line + b"\n" + whole)
    for _ in range(2):  # a refused file is not kept locked
        with pytest.raises(InputError, match=r"results\.jsonl: line 2: .*; delete the line"):
            Store(path, {}, read_only=read_only)
    assert path.read_bytes() == whole + line + b"\n" + whole


def test_one_run_at_a_time_writes(tmp_path: Path) -> None:
    """A second run on the same folder is refused until the first ends; a reader is not."""
    path = tmp_path / "results.jsonl"
    with Store(path, {}) as first:
        first.put("a", "one", {"x": 1})
        with pytest.raises(InputError, match="--out: another run is at it"):
            Store(path, {})
        assert Store(path, {}, read_only=True).get("a", "one") is not None
        first.put("a", "two", {"x": 2})
    with Store(path, {}) as second:
        assert second.get("a", "two") is not None


def test_reading_makes_nothing(tmp_path: Path) -> None:
    """Who only looks leaves no file behind."""
    assert Store(tmp_path / "none" / "results.jsonl", {}, read_only=True).get("a", "b") is None
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    """The user's mistake, in one line."""
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--out"):
        Store(tmp_path / "file" / "results.jsonl", {})


def test_a_full_disk_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What cannot be kept is no result."""

    def full(file: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with Store(tmp_path / "results.jsonl", {}) as store:
        with pytest.raises(OSError, match=r"No space left.*results\.jsonl"):
            store.put("a", "one", {"x": 1})
        assert store.get("a", "one") is None

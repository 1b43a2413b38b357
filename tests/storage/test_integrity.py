"""The check finds a sound database sound and a damaged one damaged."""

from __future__ import annotations

from pathlib import Path

import pytest

import storage
from slipstream.errors import InputError


@pytest.mark.slow
def test_sound(url, make_cycle):
    """A database in use is sound, and the report has its cycles."""
    with storage.open_database(url) as database:
        for number in (1, 2, 3):
            database.record_cycle(*make_cycle(number))
        report = storage.check(url)
    assert report.ok
    assert report.cycles == 3
    assert (report.first_ns, report.last_ns) == (
        make_cycle(1)[0].started_ns,
        make_cycle(3)[0].started_ns,
    )
    assert report.schema_version == report.schema_head


def test_damaged_page(url, make_cycle):
    """Bytes overwritten in the middle of the file are found."""
    with storage.open_database(url) as database:
        for number in range(1, 60):
            database.record_cycle(*make_cycle(number))
    path = Path(url.removeprefix("sqlite:///"))
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2 // 4096 * 4096)
        file.write(b"\x55" * 4096)
    report = storage.check(url)
    assert not report.ok
    assert report.faults


@pytest.mark.parametrize("content", [None, b"diary " * 200])
def test_nothing_to_check(tmp_path, content):
    """A missing file and one that is no database give an error of one line."""
    path = tmp_path / "x.db"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"no such file|not a database") as caught:
        storage.check(f"sqlite:///{path}")
    assert caught.value.source == str(path)


def test_never_set_up(tmp_path):
    """An empty file passes for a database without a schema: not ok, and not an error."""
    path = tmp_path / "x.db"
    path.touch()
    report = storage.check(f"sqlite:///{path}")
    assert not report.ok
    assert report.schema_version is None

"""Readers wait for a database that is not there and say why they cannot read a bad one."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import pytest

import storage


def test_waits_for_the_file(url, make_cycle):
    """Before the writer has made the file there is nothing to read, and reading makes no file."""
    with storage.open_reader(url) as reader:
        assert reader.latest_cycle() is None
        assert tuple(r.plan for r in reader.latest_plan_records()) == ()
        assert reader.cycles(limit=5) == ()
        path = Path(url.removeprefix("sqlite:///"))
        assert not path.parent.exists()
        path.parent.mkdir()
        path.touch()
        assert reader.latest_cycle() is None
        with storage.open_database(url) as database:
            assert reader.latest_cycle() is None
            database.record_cycle(*make_cycle(1))
        assert reader.latest_cycle() == make_cycle(1)[0]


@pytest.mark.slow
def test_last_cycles_oldest_first(any_url, make_cycle):
    """A limited history holds the newest cycles in their order."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        for number in range(1, 6):
            database.record_cycle(*make_cycle(number))
        assert [cycle.cycle for cycle in reader.cycles(limit=3)] == [3, 4, 5]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_who_may_not_write_beside_it_reads_on_when_the_writer_has_ended(make_cycle):
    """As the dashboard's user does in the dispatcher's folder while the dispatcher is stopped."""
    folder = Path(tempfile.mkdtemp())
    try:
        url = f"sqlite:///{folder / 'x.db'}"
        with storage.open_database(url) as database:
            database.record_cycle(*make_cycle(1))
        folder.chmod(0o755)
        (folder / "x.db").chmod(0o644)
        with storage.open_reader(url) as reader:
            os.seteuid(65534)
            try:
                assert reader.latest_cycle() == make_cycle(1)[0]
            finally:
                os.seteuid(0)
            with storage.open_database(url) as database:
                database.record_cycle(*make_cycle(2))
                assert reader.latest_cycle() == make_cycle(2)[0]
    finally:
        shutil.rmtree(folder)


def test_a_file_that_is_no_database(tmp_path):
    """Every read of a file that is no database says so, and a mended file is read again."""
    path = tmp_path / "x.db"
    path.write_bytes(b"not a database at all" * 500)
    with storage.open_reader(f"sqlite:///{path}") as reader:
        for _ in range(2):
            with pytest.raises(storage.StorageError, match="not a database"):
                reader.latest_cycle()
        path.unlink()
        assert reader.latest_cycle() is None


def test_odd_characters_in_the_path(tmp_path, make_cycle):
    """A path with characters that mean something in a URI is taken as it is."""
    url = f"sqlite:///{tmp_path}/a #1 %20/x&y.db"
    with storage.open_database(url) as database, storage.open_reader(url) as reader:
        database.record_cycle(*make_cycle(1))
        assert reader.latest_cycle() == make_cycle(1)[0]


def test_reading_again_compiles_nothing_new(url, make_cycle):
    """A dashboard that reads every few seconds for months keeps no statement twice."""
    with storage.open_database(url) as database, storage.open_reader(url) as reader:
        database.record_cycle(*make_cycle(1))
        compiled = reader._engine._compiled_cache
        reader.latest_cycle()
        once = len(compiled)
        for _ in range(5):
            reader.latest_cycle()
        assert 0 < len(compiled) == once

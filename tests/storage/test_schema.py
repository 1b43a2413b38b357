"""A new database has the tables of the models; others are refused or brought up."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

import storage
from slipstream_cli.main import main
from storage import schema
from storage.engine import parse_url, writer_engine
from storage.models import Base


@pytest.mark.slow
def test_head_equals_the_models(any_url):
    """A new database has the tables, columns and indexes of the models."""
    storage.open_database(any_url).close()
    engine = writer_engine(parse_url(any_url))
    options = {"compare_type": True, "compare_server_default": True}
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts=options)
        assert compare_metadata(context, Base.metadata) == []
        assert schema.current(connection) == schema.HEAD
    engine.dispose()


def test_one_line_of_revisions():
    """There is one head, reached from one base."""
    script = ScriptDirectory(str(schema.MIGRATIONS))
    assert script.get_heads() == [schema.HEAD]
    assert len(script.get_bases()) == 1


def test_a_broken_upgrade_leaves_nothing(url, monkeypatch):
    """An upgrade that fails half-way leaves an empty database, which the next one brings up."""

    def fail(*_):
        raise RuntimeError("power cut")

    with monkeypatch.context() as patch:
        patch.setattr("alembic.command.stamp", fail)
        with pytest.raises(RuntimeError, match="power cut"):
            storage.open_database(url)
    with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as connection:
        assert connection.execute("SELECT name FROM sqlite_master").fetchall() == []
    with storage.open_database(url) as database:
        assert database.next_cycle_number() == 1


@pytest.mark.parametrize("revision", ["0001", "0020"])
def test_a_database_of_before_the_first_release_is_refused(url, revision, capsys):
    """By every command and the page, in one line that says what to do; nothing of it changes."""
    storage.open_database(url).close()
    path = Path(url.removeprefix("sqlite:///"))
    with closing(sqlite3.connect(path)) as old:
        old.execute("UPDATE alembic_version SET version_num = ?", (revision,))
        old.commit()
    before = path.read_bytes()
    said = f"before the first release (schema {revision}, read from 0021 on)"
    for command in (["upgrade"], ["check"], ["prune", "--keep-days", "1"]):
        assert main(["db", *command, "--url", url]) == 2
        line = capsys.readouterr().err
        assert said in line
        assert "move it away, or give another" in line
        assert line.count("\n") == 1
    with storage.open_reader(url) as reader, pytest.raises(storage.StorageError) as refused:
        reader.latest_cycle()
    assert said in str(refused.value)
    assert path.read_bytes() == before

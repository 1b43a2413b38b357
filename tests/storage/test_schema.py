"""Migrations lead from nothing to exactly the models."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import create_engine

import storage
from slipstream_cli.main import main
from storage import schema
from storage.engine import parse_url, writer_engine
from storage.models import Base

VERSION_TABLE = "alembic_version"


def test_head_equals_the_models(any_url):
    """Upgrading an empty database gives the tables, columns and indexes of the models."""
    storage.open_database(any_url).close()
    engine = writer_engine(parse_url(any_url))
    options = {"compare_type": True, "compare_server_default": True}
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts=options)
        assert compare_metadata(context, Base.metadata) == []
        assert schema.current(connection) == schema.head()
    engine.dispose()


def test_head_is_the_sql_of_the_models(url):
    """Of an SQLite file to the letter: keys, their actions, and which tables have no row number."""
    storage.open_database(url).close()
    made = create_engine("sqlite://")
    Base.metadata.create_all(made)
    upgraded = create_engine(url)
    found = []
    for engine in (made, upgraded):
        with engine.connect() as connection:
            rows = connection.exec_driver_sql("SELECT name, sql FROM sqlite_master")
            found.append({name: _parts(sql) for name, sql in rows if name != VERSION_TABLE and sql})
        engine.dispose()
    assert found[0] == found[1]


def _parts(sql: str) -> list[str]:
    """The parts of a statement, whose constraints may stand in another order."""
    return sorted(line.strip().rstrip(",").strip() for line in sql.splitlines())


def test_one_line_of_revisions():
    """There is one head, reached from one base."""
    script = ScriptDirectory(str(schema.MIGRATIONS))
    assert len(script.get_heads()) == 1
    assert len(script.get_bases()) == 1


def test_a_broken_upgrade_leaves_nothing(url, monkeypatch):
    """An upgrade that fails half-way leaves an empty database, which the next one brings up."""
    from alembic import op

    create_table = op.create_table

    def fail_at_plans(name, *columns, **options):
        if name == "plans":
            raise RuntimeError("power cut")
        return create_table(name, *columns, **options)

    with monkeypatch.context() as patch:
        patch.setattr(op, "create_table", fail_at_plans)
        with pytest.raises(RuntimeError, match="power cut"):
            storage.open_database(url)
    connection = sqlite3.connect(url.removeprefix("sqlite:///"))
    assert connection.execute("SELECT name FROM sqlite_master").fetchall() == []
    connection.close()
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
    said = f"before the first release (schema {revision}, read from {schema.head()} on)"
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

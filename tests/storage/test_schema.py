"""Migrations lead from nothing to exactly the models."""

from __future__ import annotations

import sqlite3

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

import storage
from storage import schema
from storage.engine import parse_url, writer_engine
from storage.models import Base


def test_head_equals_the_models(url):
    """Upgrading an empty database gives the tables, columns and indexes of the models."""
    storage.open_database(url).close()
    engine = writer_engine(parse_url(url))
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, Base.metadata) == []
        assert schema.current(connection) == schema.head()
    engine.dispose()


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

"""The version of a database's schema, and the way up to the one this program knows."""

from __future__ import annotations

import logging
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, inspect

from slipstream.errors import InputError

# It logs each look at a version as information.
logging.getLogger("alembic.runtime.migration").setLevel(logging.WARNING)

MIGRATIONS = Path(__file__).parent / "migrations"


def head() -> str:
    """The revision that this program's models describe."""
    revision = ScriptDirectory(str(MIGRATIONS)).get_current_head()
    assert revision is not None
    return revision


def current(connection: Connection) -> str | None:
    """The revision that the database is at; None where it has never been set up."""
    return MigrationContext.configure(connection).get_current_revision()


def refuse_foreign(connection: Connection, source: str) -> None:
    """See that the database is empty or ours, and not newer than this program.

    Raises:
        InputError: another program's tables are in it, or its schema is not known here.
    """
    revision = current(connection)
    if revision is None:
        tables = inspect(connection).get_table_names()
        if tables:
            raise InputError(
                source,
                f"holds another program's tables ({', '.join(sorted(tables)[:3])})",
                "give a file of its own",
            )
        return
    known = {script.revision for script in ScriptDirectory(str(MIGRATIONS)).walk_revisions()}
    if revision not in known:
        raise InputError(
            source,
            f"was written by a newer Slipstream (schema {revision}, known up to {head()})",
            "install that version, or give another file",
        )


def upgrade(connection: Connection) -> None:
    """Bring the schema to `head` inside the transaction that the connection is in."""
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    config.attributes["connection"] = connection
    command.upgrade(config, "head")

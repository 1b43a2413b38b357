"""The version of a database's schema, and the way up to the one this program knows."""

from __future__ import annotations

import logging
from functools import cache
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, inspect

from slipstream.errors import InputError

# It logs each look at a version as information.
logging.getLogger("alembic.runtime.migration").setLevel(logging.WARNING)

MIGRATIONS = Path(__file__).parent / "migrations"
_VERSION_TABLE = "alembic_version"


@cache
def head() -> str:
    """The revision that this program's models describe."""
    revision = ScriptDirectory(str(MIGRATIONS)).get_current_head()
    assert revision is not None
    return revision


@cache
def _known() -> frozenset[str]:
    """All revisions that this program can read or upgrade."""
    scripts = ScriptDirectory(str(MIGRATIONS)).walk_revisions()
    return frozenset(script.revision for script in scripts)


def current(connection: Connection) -> str | None:
    """The revision that the database is at; None where it has never been set up."""
    # Alembic's own look makes a new Table each time, which stays in SQLAlchemy's cache of compiled
    # statements: 20 MB in an hour of a dashboard that looks every 5 s.
    if not inspect(connection).has_table(_VERSION_TABLE):
        return None
    row = connection.exec_driver_sql(f"SELECT version_num FROM {_VERSION_TABLE}").first()
    return None if row is None else str(row[0])


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
    if revision not in _known():
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

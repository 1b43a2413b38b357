"""The revision of a database's schema, and its upgrade to this program's revision."""

from __future__ import annotations

import logging
from functools import cache
from pathlib import Path
from typing import Final

from sqlalchemy import Connection, inspect

from slipstream.errors import InputError
from storage.models import Base
from storage.records import energy_ledger as _of_energy  # noqa: F401 (its table joins those of Base)
from storage.traffic import models as _of_traffic  # noqa: F401 (their tables join those of Base)

# Alembic logs each query of the revision at INFO.
logging.getLogger("alembic.runtime.migration").setLevel(logging.WARNING)

MIGRATIONS = Path(__file__).parent / "migrations"
HEAD: Final = "0022"
"""The revision of this program's models. Alembic would tell it in a fifth of a second."""
_VERSION_TABLE = "alembic_version"


@cache
def _known() -> frozenset[str]:
    """All revisions that this program can upgrade."""
    from alembic.script import ScriptDirectory

    scripts = ScriptDirectory(str(MIGRATIONS)).walk_revisions()
    return frozenset(script.revision for script in scripts)


def current(connection: Connection) -> str | None:
    """The revision of the database; None if it has no schema."""
    # Alembic's own query makes a new Table each time, which stays in SQLAlchemy's cache of compiled
    # statements: 20 MB in an hour at one query every 5 s.
    if not inspect(connection).has_table(_VERSION_TABLE):
        return None
    row = connection.exec_driver_sql(f"SELECT version_num FROM {_VERSION_TABLE}").first()
    return None if row is None else str(row[0])


def check_ownership(connection: Connection, source: str) -> None:
    """Check that the database is empty or Slipstream's, of a revision that this program knows.

    Raises:
        InputError: it holds another program's tables, or an older or newer revision than known.
    """
    revision = current(connection)
    if revision == HEAD:
        return
    if revision is None:
        tables = inspect(connection).get_table_names()
        if tables:
            raise InputError(
                source,
                f"holds another program's tables ({', '.join(sorted(tables)[:3])})",
                "give a file of its own",
            )
        return
    if revision < min(_known()):
        raise InputError(
            source,
            f"was written by a Slipstream before the first release (schema {revision}, read from "
            f"{min(_known())} on)",
            "move it away, or give another: a new one is made",
        )
    if revision not in _known():
        raise InputError(
            source,
            f"was written by a newer Slipstream (schema {revision}, known up to {HEAD})",
            "install that version, or give another file",
        )


def upgrade(connection: Connection) -> None:
    """Bring the schema to `head` inside the connection's transaction: a new database gets the
    tables of the models, another one the revisions since its own.
    """
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    config.attributes["connection"] = connection
    if current(connection) is None:
        Base.metadata.create_all(connection)
        command.stamp(config, "head")
    else:
        command.upgrade(config, "head")

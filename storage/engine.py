"""Database URLs and engines; SQLite is opened so that a commit is durable."""

from __future__ import annotations

import sqlite3
from itertools import islice
from pathlib import Path
from typing import Final
from urllib.parse import quote

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import URL, ExceptionContext, make_url
from sqlalchemy.exc import ArgumentError, DatabaseError, NoSuchModuleError
from sqlalchemy.pool import NullPool

from slipstream.errors import InputError

BUSY_TIMEOUT_MS: Final = 10_000
LOG_LIMIT_BYTES: Final = 4 * 2**20
"""A write-ahead log that has grown beyond this is cut back to it once it has been copied."""
DAMAGED: Final = "database disk image is malformed"
NO_DATABASE: Final = "file is not a database"
"""What SQLite says of a damaged file."""
_POSTGRESQL_OPTIONS: Final = {
    "connect_timeout": "5",
    "keepalives_idle": "3",
    "keepalives_interval": "1",
    "keepalives_count": "3",
    "tcp_user_timeout": "6000",
}
"""Options of libpq: times in s, but the last one in ms."""
MAX_FAULTS: Final = 100
"""Number of faults after which a check stops to look for more."""


class StorageError(OSError):
    """The database could not be read or written: disk full, locked, damaged, missing.

    Its message is one line. It is no InputError: the cause may be temporary and is not a user's
    mistake.
    """

    def __init__(self, line: str) -> None:
        super().__init__(" ".join(line.split()))


class OrderKnownError(StorageError):
    """Orders were to be added, and some of their ids are stored already; none was added."""


def parse_url(url: str) -> URL:
    """Read a database URL.

    Raises:
        InputError: it is no URL, names no file, or names an in-memory database.
    """
    try:
        parsed = make_url(url)
    except (ArgumentError, ValueError):  # such as a port that is no number
        raise InputError(
            url, "not a database URL", "write it like sqlite:////var/lib/slipstream/slipstream.db"
        ) from None
    if parsed.port is not None and not 0 < parsed.port < 2**16:
        raise InputError(display_name(parsed), "no such port", "give one from 1 to 65535")
    if parsed.drivername in ("postgres", "postgresql"):
        # The driver of `slipstream[postgres]`; SQLAlchemy's default is another one.
        parsed = parsed.set(drivername="postgresql+psycopg")
    if is_sqlite(parsed) and (
        not parsed.database or parsed.database == ":memory:" or parsed.database.startswith("file:")
    ):
        raise InputError(
            url, "names no file", "write it like sqlite:////var/lib/slipstream/slipstream.db"
        )
    return parsed


def is_sqlite(url: URL) -> bool:
    """True if the database is an SQLite file."""
    return url.get_backend_name() == "sqlite"


def sqlite_path(url: URL) -> Path:
    """The file that an SQLite URL names."""
    assert url.database is not None
    return Path(url.database)


def read_only_address(path: Path) -> str:
    """A file as SQLite opens it for reading alone."""
    return f"file:{quote(str(path.absolute()))}?mode=ro"


def log_path(path: Path) -> Path:
    """The log beside a file, in which its last commits are while a writer has it open."""
    return path.with_name(f"{path.name}-wal")


def display_name(url: URL) -> str:
    """Name of the database in messages: the file, or the URL without its password."""
    return str(sqlite_path(url)) if is_sqlite(url) else url.render_as_string(hide_password=True)


def writer_engine(url: URL) -> Engine:
    """Engine of the one writer; every transaction takes the write lock when it begins.

    ``synchronous`` is FULL. Under WAL, NORMAL survives the end of the process but syncs the log at
    checkpoints only, so a power failure can lose the last commits. FULL syncs the log at each
    commit; at one commit a cycle its cost is negligible.

    Raises:
        InputError: the driver of the URL is not installed.
    """
    engine = _create(url)
    if is_sqlite(url):
        _report_undecodable_text(engine)

        @event.listens_for(engine, "connect")
        def _prepare(connection: sqlite3.Connection, _record: object) -> None:
            # The driver must not open transactions of its own: it would begin them DEFERRED.
            connection.isolation_level = None
            _pragmas(
                connection,
                f"busy_timeout={BUSY_TIMEOUT_MS}",
                # Before WAL, which writes the file's first page. Older files are left as they are.
                "auto_vacuum=INCREMENTAL",
                "journal_mode=WAL",
                f"journal_size_limit={LOG_LIMIT_BYTES}",
                "synchronous=FULL",
                "foreign_keys=ON",
            )

        @event.listens_for(engine, "begin")
        def _begin(connection: object) -> None:
            connection.exec_driver_sql("BEGIN IMMEDIATE")  # type: ignore[attr-defined]

    return engine


_MAY_NOT_WRITE: Final = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY)


def reader_engine(url: URL) -> Engine:
    """Engine that cannot write and keeps no connection open between two reads.

    Raises:
        InputError: the driver of the URL is not installed.
    """
    if not is_sqlite(url):
        # One snapshot for all the queries of a read, as below.
        return _create(url).execution_options(
            postgresql_readonly=True, isolation_level="REPEATABLE READ"
        )
    path = sqlite_path(url).absolute()
    address = read_only_address(path)

    def connect() -> sqlite3.Connection:
        try:
            return _reading(address)
        except sqlite3.OperationalError as error:
            # Who may not write beside it cannot open a file in WAL mode whose writer has ended; as
            # nobody writes, it can be read as one that does not change.
            is_refused = error.sqlite_errorcode & 0xFF in _MAY_NOT_WRITE
            if not is_refused or not path.exists() or log_path(path).exists():
                raise
            return _reading(f"{address}&immutable=1")

    engine = create_engine("sqlite://", creator=connect, poolclass=NullPool)
    _report_undecodable_text(engine)

    @event.listens_for(engine, "begin")
    def _begin(connection: object) -> None:
        # One snapshot for all the queries of a read.
        connection.exec_driver_sql("BEGIN")  # type: ignore[attr-defined]

    return engine


def _reading(address: str) -> sqlite3.Connection:
    connection = sqlite3.connect(address, uri=True, timeout=BUSY_TIMEOUT_MS / 1000)
    connection.isolation_level = None
    # The first of them that reads the file says whether it can be opened.
    _pragmas(connection, f"busy_timeout={BUSY_TIMEOUT_MS}", "query_only=ON", "schema_version")
    return connection


def sqlite_faults(connection: Connection) -> list[str]:
    """Faults of an SQLite file, at most `MAX_FAULTS` of each kind; reads the whole file."""
    faults: list[str] = []
    for row in connection.exec_driver_sql(f"PRAGMA integrity_check({MAX_FAULTS})"):
        faults += [line for line in str(row[0]).splitlines() if line != "ok"]
    with connection.exec_driver_sql("PRAGMA foreign_key_check") as rows:
        for row in islice(rows, MAX_FAULTS):
            faults.append(f"row {row[1]} of {row[0]} belongs to no row of {row[2]}")
    return faults


def _create(url: URL) -> Engine:
    if url.drivername == "postgresql+psycopg":
        # A server that is gone without a word is noticed; options in the URL come first.
        url = url.update_query_dict({**_POSTGRESQL_OPTIONS, **url.query})
    try:
        # A file's connection cannot be cut.
        return create_engine(url, pool_pre_ping=not is_sqlite(url))
    except (NoSuchModuleError, ModuleNotFoundError) as error:
        raise InputError(
            display_name(url),
            f"no driver for it: {error}",
            "use sqlite:///FILE, or install slipstream[postgres] for postgresql://",
        ) from None


def _report_undecodable_text(engine: Engine) -> None:
    """Have damaged names, which the driver cannot decode, reported as other damage is."""

    @event.listens_for(engine, "handle_error")
    def _handle(context: ExceptionContext) -> BaseException | None:
        if not isinstance(context.original_exception, UnicodeDecodeError):
            return None
        return DatabaseError(context.statement, None, sqlite3.DatabaseError(DAMAGED))


def _pragmas(connection: sqlite3.Connection, *settings: str) -> None:
    for setting in settings:
        connection.execute(f"PRAGMA {setting}").close()

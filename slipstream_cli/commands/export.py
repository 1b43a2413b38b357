"""`slipstream export` or `db export`: tables of the database as CSV or Parquet, at any time.

After the word `instance`: instances in the formats of benchmark libraries.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream.iso_time import read_datetime
from slipstream_cli.export_files import FORMATS, write_table
from slipstream_cli.laboratory import part

_DEFAULT: Final = "sqlite:///slipstream.db"
_ALL: Final = "all"
_INSTANCE: Final = "instance"
_OF_INSTANCES: Final = ("qoblib", "lp", "mps", "qs")
"""Formats of instances, which the laboratory writes."""


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command, to the top or to `slipstream db`."""
    command = commands.add_parser("export", help="tables of the database, or instances, as files")
    command.add_argument("table", help="its name, or 'all'; or 'instance', with names or files")
    command.add_argument(
        "names", nargs="*", metavar="NAME|FILE", help="after 'instance': which ones, or 'all'"
    )
    command.add_argument("--database", default=_DEFAULT, help=f"database URL (default: {_DEFAULT})")
    command.add_argument(
        "--from",
        dest="begin",
        metavar="T",
        help="rows from this time on: ISO 8601, UTC unless it says otherwise (default: the first)",
    )
    command.add_argument(
        "--to", dest="end", metavar="T", help="rows before this time (default: the last)"
    )
    command.add_argument(
        "--format",
        choices=(*FORMATS, *_OF_INSTANCES),
        help="of tables: csv or parquet (default: csv); of instances: qoblib, with solutions, "
        "models and a checker, or one model file each (default: qoblib)",
    )
    command.add_argument("--out", type=Path, required=True, help="folder for the files")
    command.add_argument("--force", action="store_true", help="overwrite files that are there")
    command.add_argument("--json", action="store_true", help="report as JSON")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the files; each table's appears once it is whole."""
    if options.table == _INSTANCE:
        return int(part("export-instance", "slipstream export instance")(options))
    if options.names:
        raise InputError("export", f"{options.names[0]!r} after a table", "name one table, or all")
    options.format = options.format or FORMATS[0]
    if options.format not in FORMATS:
        mend = f"take {' or '.join(FORMATS)}"
        raise InputError("export", f"{options.format} is for instances", mend, key="--format")
    begin, end = _time(options.begin, "--from"), _time(options.end, "--to")
    if begin is not None and end is not None and begin >= end:
        raise InputError("export", "the range is empty", "give --from before --to", key="--from")
    if options.format == "parquet":
        # Before anything is written: main says what to install.
        import pyarrow  # noqa: F401
    from storage import StorageError, open_reader, table_names

    names: Sequence[str] = table_names() if options.table == _ALL else (options.table,)
    if not set(names) <= set(table_names()):
        known = ", ".join(table_names())
        raise InputError("export", f"no table {options.table!r}", f"use all, or one of: {known}")
    paths = {name: options.out / f"{name}.{options.format}" for name in names}
    _check_free(options.out, () if options.force else tuple(paths.values()))
    written = {}
    try:
        with open_reader(options.database) as reader, reader.tables() as tables:
            options.out.mkdir(parents=True, exist_ok=True)
            for name, path in paths.items():
                rows = tables.rows(name, begin, end)
                written[name] = write_table(path, tables.columns(name), rows)
    except StorageError as error:
        raise InputError("export", str(error), "run slipstream db check") from None
    if options.json:
        files = {name: {"file": str(paths[name]), "rows": n} for name, n in written.items()}
        print(json.dumps(files))
        return 0
    for name, count in written.items():
        print(f"{paths[name]}: {count} rows")
    return 0


def _check_free(folder: Path, paths: Sequence[Path]) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "is no folder", "give a folder", key="--out")
    for path in paths:
        if path.exists():
            raise InputError(path, "is there already", "give --force, or another --out")


def _time(text: str | None, option: str) -> int | None:
    """UTC ns of a time on the command line."""
    if text is None:
        return None
    mend = "write it like 2026-11-23T07:00:00Z"
    try:
        given = read_datetime(text)
    except ValueError:
        raise InputError("export", f"{text!r} is no time", mend, key=option) from None
    at = given if given.tzinfo is not None else given.replace(tzinfo=UTC)
    since = at - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1000

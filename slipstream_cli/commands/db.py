"""`slipstream db`: upgrade, check, prune, back up, restore and export the dispatcher's database."""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.errors import InputError
from slipstream.orders import utc
from slipstream_cli.commands import export

if TYPE_CHECKING:
    from storage import CheckReport

_DEFAULT = "sqlite:///slipstream.db"


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("db", help="look after the database")
    actions = command.add_subparsers(dest="action", required=True, metavar="ACTION")
    for name, text, function in (
        ("upgrade", "create the database or bring its schema up to date", upgrade),
        ("check", "check that it is sound and up to date; exit status 1 if not", check),
        ("prune", "delete old cycles and make the file smaller, on a full disk too", prune),
        ("backup", "copy the database to a new file while it is written, and check it", backup),
        ("restore", "put a backup in its place, and keep what was there; no dispatcher", restore),
    ):
        action = actions.add_parser(name, help=text)
        if name in ("backup", "restore"):
            action.add_argument("file", type=Path, metavar="FILE", help="the backup")
        action.add_argument(
            *("--database", "--url"),
            dest="url",
            default=_DEFAULT,
            help=f"database URL (default: {_DEFAULT})",
        )
        if name == "prune":
            action.add_argument("--keep-days", type=float, help="delete cycles older than this")
            action.add_argument(
                "--keep-mb", type=float, help="delete the oldest cycles until the others fit (MB)"
            )
            action.add_argument(
                "--trust-clock",
                action="store_true",
                help="this machine's clock is right, however far ahead of the cycles it is",
            )
        action.add_argument("--json", action="store_true", help="report as JSON")
        action.set_defaults(run=function)
    export.add_to(actions)


def upgrade(options: argparse.Namespace) -> int:
    """Create or upgrade the schema."""
    from storage import open_database

    open_database(options.url).close()
    _report(options, {"url": options.url, "upgraded": True}, f"{options.url}: up to date")
    return 0


def check(options: argparse.Namespace) -> int:
    """Report on integrity and schema."""
    import storage

    report = storage.check(options.url)
    _report(options, asdict(report), f"{report.database}: {_told(report)}")
    return 0 if report.ok else 1


def _told(report: CheckReport) -> str:
    """What a check found, in one line."""
    if report.faults:
        first, *others = report.faults
        more = f" and {len(others)} more" if others else ""
        return f"damaged: {first}{more}; put a backup in its place: slipstream db restore"
    if report.schema_version is None:
        return "no schema yet; run slipstream db upgrade"
    cycles = f"{report.cycles} cycles" if report.cycles != 1 else "1 cycle"
    if report.first_ns is not None and report.last_ns is not None:
        cycles += f" from {utc(report.first_ns)} to {utc(report.last_ns)}"
    size = "" if report.size_bytes is None else f", {report.size_bytes / 1e6:.1f} MB"
    if report.schema_version != report.schema_head:
        old = f"schema {report.schema_version}, where this version has {report.schema_head}"
        return f"sound, but {old}: run slipstream db upgrade; {cycles}{size}"
    return f"sound, schema {report.schema_version}, {cycles}{size}"


def prune(options: argparse.Namespace) -> int:
    """Delete old cycles and give their room back to the file system."""
    from storage import headroom, open_database

    if options.keep_days is None and options.keep_mb is None and not options.trust_clock:
        raise InputError("db prune", "nothing to do", "give --keep-days, --keep-mb or both")
    count = 0
    with headroom(options.url), open_database(options.url, create=False) as database:
        if options.trust_clock:
            database.trust_clock(time.time_ns())
        if options.keep_days is not None:
            count += database.prune(options.keep_days, time.time_ns())
            database.tidy(time.time_ns())
        if options.keep_mb is not None:
            count += database.trim(options.keep_mb)
        database.shrink()
    data = {"url": options.url, "deleted_cycles": count}
    _report(options, data, f"{count} cycles deleted")
    return 0


def backup(options: argparse.Namespace) -> int:
    """Copy the database while the dispatcher writes it."""
    import storage

    report = storage.backup(options.url, options.file)
    line = f"{options.file}: {report.cycles} cycles, {(report.size_bytes or 0) / 1e6:.1f} MB, sound"
    _report(options, asdict(report) | {"file": str(options.file)}, line)
    return 0


def restore(options: argparse.Namespace) -> int:
    """Put a backup in place of the database."""
    import storage

    aside = storage.restore(options.url, options.file)
    kept = "" if aside is None else f"; the former database is {aside}"
    data = {"url": options.url, "file": str(options.file), "former": aside and str(aside)}
    _report(options, data, f"{options.url}: restored from {options.file}{kept}")
    return 0


def _report(options: argparse.Namespace, data: dict[str, object], line: str) -> None:
    print(json.dumps(data, default=str) if options.json else line)

"""`slipstream db`: upgrade, check and prune the dispatcher's database."""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict

_DEFAULT = "sqlite:///slipstream.db"


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("db", help="look after the database")
    actions = command.add_subparsers(dest="action", required=True, metavar="ACTION")
    for name, text, function in (
        ("upgrade", "create the database or bring its schema up to date", upgrade),
        ("check", "check that it is sound and up to date; exit status 1 if not", check),
        ("prune", "delete cycles older than --keep-days", prune),
    ):
        action = actions.add_parser(name, help=text)
        action.add_argument("--url", default=_DEFAULT, help=f"database URL (default: {_DEFAULT})")
        if name == "prune":
            action.add_argument("--keep-days", type=float, required=True)
        action.add_argument("--json", action="store_true", help="report as JSON")
        action.set_defaults(run=function)


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
    _report(options, asdict(report), f"{options.url}: {report}")
    return 0 if report.ok else 1


def prune(options: argparse.Namespace) -> int:
    """Delete old cycles."""
    from storage import open_database

    database = open_database(options.url, create=False)
    try:
        count = database.prune(options.keep_days, time.time_ns())
    finally:
        database.close()
    _report(options, {"url": options.url, "deleted_cycles": count}, f"{count} cycles deleted")
    return 0


def _report(options: argparse.Namespace, data: dict[str, object], line: str) -> None:
    print(json.dumps(data, default=str) if options.json else line)

"""One cycle of the dispatcher's database, for the commands that tell of it."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from slipstream.errors import InputError

if TYPE_CHECKING:
    from storage import Reader, StoredCycle

_DEFAULT: Final = "sqlite:///slipstream.db"
_LATEST: Final = "latest"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Which cycle of which database."""
    command.add_argument("cycle", metavar="CYCLE", help=f"number of a cycle, or {_LATEST}")
    command.add_argument(
        "--database", default=_DEFAULT, metavar="URL", help=f"database URL (default: {_DEFAULT})"
    )
    command.add_argument("--json", action="store_true", help="report as JSON")


@contextmanager
def stored_cycle(options: argparse.Namespace) -> Iterator[tuple[Reader, StoredCycle]]:
    """The reader of the database, and the cycle that was asked for.

    Raises:
        InputError: there is no such database or cycle, or what is stored cannot be read.
    """
    from storage import StorageError, open_reader

    url, name = options.database, options.cycle
    if name != _LATEST and not (name.isascii() and name.isdigit() and int(name) < 2**63):
        raise InputError("CYCLE", f"{name!r} is no cycle", f"give its number, or {_LATEST}")
    with open_reader(url) as reader:
        try:
            if not reader.exists():
                mend = "give the dispatcher's database_url with --database"
                raise InputError(url, "no database there", mend)
            last = reader.latest_cycle()
            if last is None:
                raise InputError(url, "no cycle is stored yet", "wait for the dispatcher's first")
            number = last.cycle if name == _LATEST else int(name)
            found = reader.stored_cycle(number)
            if found is None:
                mend = f"give one that is stored, up to {last.cycle}; old ones are deleted"
                raise InputError(url, f"has no cycle {number}", mend)
            try:
                yield reader, found
            except ValueError as error:
                line = " ".join(str(error).split())[:300]
                mend = "use the version of Slipstream that stored it"
                raise InputError(url, line, mend, key=f"cycle {number}") from None
        except StorageError as error:
            problem = str(error).removeprefix(f"{url}: ")
            raise InputError(url, problem, "run slipstream db check") from None

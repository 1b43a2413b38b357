"""`slipstream token`: bearer tokens for the dispatcher's HTTP API."""

from __future__ import annotations

import argparse
import os
import secrets
from pathlib import Path

import tomli_w

from slipstream.config import MAX_TOML_BYTES, load
from slipstream.errors import InputError
from slipstream.files import read_text

_DEFAULT = Path("api-tokens.toml")
_BYTES = 32


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("token", help="tokens for the dispatcher's HTTP API")
    actions = command.add_subparsers(dest="action", required=True, metavar="ACTION")
    new = actions.add_parser(
        "new",
        help="make a token",
        description="Adds a token to the file that api.tokens of the dispatcher's settings names, "
        "and prints it once: the file has its hash alone. A dispatcher that reads the file itself "
        "sees it at once, one that gets a copy from systemd after a restart. To withdraw a token, "
        "remove its table from the file.",
    )
    new.add_argument("name", help="whose token it is")
    new.add_argument(
        "--scopes",
        required=True,
        help="what it may do, separated by commas: read, orders, control, vehicles (docs/api.md)",
    )
    new.add_argument(
        "--file", type=Path, default=_DEFAULT, help=f"file of tokens (default: {_DEFAULT})"
    )
    new.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Make one."""
    from dispatcher_daemon.service.api import Token, TokenList, token_hash
    from slipstream.config import check

    path: Path = options.file
    known = load(path, TokenList).tokens if path.exists() else ()
    if any(token.name == options.name for token in known):
        raise InputError(path, f"a token {options.name!r} is there", "take another name")
    secret = secrets.token_urlsafe(_BYTES)
    table = {
        "name": options.name,
        "sha256": token_hash(secret.encode()),
        "scopes": [scope.strip() for scope in options.scopes.split(",")],
    }
    check(table, Token, "token new")
    entry = tomli_w.dumps({"tokens": [table]})
    try:
        before = read_text(path, MAX_TOML_BYTES) if path.exists() else ""
        _replace(path, f"{before.rstrip()}\n\n{entry}".lstrip())
    except OSError as error:
        problem = error.strerror or "not writable"
        raise InputError(path, problem, "give a file that can be written") from None
    print(secret)
    return 0


def _replace(path: Path, text: str) -> None:
    """Write a file of our own as a whole; owner and rights stay, a new one is its owner's alone."""
    new = path.with_name(f"{path.name}.new")
    former = path.stat() if path.exists() else None
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o600)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            if former is not None:
                # Root adds a token to a file that the dispatcher's user reads.
                os.fchown(descriptor, former.st_uid, former.st_gid)
                os.fchmod(descriptor, former.st_mode & 0o777)
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)

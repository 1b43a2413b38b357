"""`slipstream orders`: the orders in the dispatcher's database, and the life of one of them; orders
over its API.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict

from slipstream.errors import InputError
from slipstream.orders import ORDER_STATES, OrderChange, OrderRecord, utc
from slipstream_cli.commands import order_calls

_DEFAULT = "sqlite:///slipstream.db"


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "orders", help="orders: what became of each; submit, cancel, pin, release, settle"
    )
    actions = command.add_subparsers(dest="action", required=True, metavar="ACTION")
    listing = actions.add_parser(
        "list", help="all orders, those that changed last at the end; or the life of one"
    )
    listing.add_argument("order", nargs="?", help="one order: each change of its state")
    listing.add_argument(
        *("--database", "--url"),
        dest="url",
        default=_DEFAULT,
        help=f"database URL (default: {_DEFAULT})",
    )
    listing.add_argument(
        "--state",
        action="append",
        choices=ORDER_STATES,
        help="only orders in this state; may be given more than once",
    )
    listing.add_argument("--json", action="store_true", help="report as JSON")
    listing.set_defaults(run=run)
    order_calls.add_to(actions)


def run(options: argparse.Namespace) -> int:
    """Print them."""
    from storage import StorageError, open_reader

    with open_reader(options.url) as reader:
        try:
            if not reader.exists():
                mend = "give the dispatcher's database_url with --database"
                raise InputError(options.url, "no database there", mend)
            if options.order is not None:
                found: Sequence[OrderRecord | OrderChange] = reader.order_changes(options.order)
            else:
                found = reader.orders(tuple(options.state or ORDER_STATES))
        except StorageError as error:
            problem = str(error).removeprefix(f"{options.url}: ")
            raise InputError(options.url, problem, "run slipstream db check") from None
    if options.order is not None and not found:
        raise InputError("orders list", f"no order {options.order!r}", "list all orders first")
    if options.json:
        print(json.dumps([asdict(row) for row in found]))
        return 0
    for row in found:
        print(_line(row))
    return 0


def _line(row: OrderRecord | OrderChange) -> str:
    time_ns = row.since_ns if isinstance(row, OrderRecord) else row.time_ns
    return f"{utc(time_ns)}  {row.state:<9}  {row.order}  {row.reason}"

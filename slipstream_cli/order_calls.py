"""`slipstream orders add|show|cancel`: orders over a dispatcher's API."""

from __future__ import annotations

import argparse
import http.client
import json
import os
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote, urlsplit

from slipstream.config import parse_json, read_secret
from slipstream.errors import InputError
from slipstream.files import read_file

_WITHIN_S: Final = 30.0
_MAX_FILE_BYTES: Final = 1_000_000
_TOKEN: Final = "SLIPSTREAM_TOKEN"


def add_to(actions: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the actions."""
    adding = actions.add_parser("add", help="submit the orders of a JSON file, all or none")
    adding.add_argument("file", type=Path, help="an order as an object, or up to 1000 in a list")
    showing = actions.add_parser("show", help="an order as it is now, with its life")
    cancelling = actions.add_parser("cancel", help="cancel an order that no vehicle has left with")
    for action in (showing, cancelling):
        action.add_argument("order", help="its id")
    for action, run in ((adding, _add), (showing, _show), (cancelling, _cancel)):
        action.add_argument("--api", required=True, help="such as http://127.0.0.1:8090")
        action.add_argument(
            "--token-file", type=Path, help=f"file with the token; else ${_TOKEN} is taken"
        )
        action.set_defaults(run=run)


def _add(options: argparse.Namespace) -> int:
    data = read_file(options.file, _MAX_FILE_BYTES)
    rows = parse_json(data, options.file)
    rows = rows if isinstance(rows, list) else [rows]
    answer = _call(options, "POST", "/v1/orders", rows, str(options.file))
    for receipt in answer["receipts"]:
        print(f"{receipt['order']}  at {receipt['node']}")
    return 0


def _show(options: argparse.Namespace) -> int:
    path = f"/v1/orders/{quote(options.order, safe='')}"
    print(json.dumps(_call(options, "GET", path, None, options.order), indent=2))
    return 0


def _cancel(options: argparse.Namespace) -> int:
    path = f"/v1/orders/{quote(options.order, safe='')}"
    answer = _call(options, "DELETE", path, None, options.order)
    print(f"{answer['order']}  {answer['state']}  {answer['reason']}")
    return 0


def _call(options: argparse.Namespace, method: str, path: str, body: object, source: str) -> Any:
    """The answer's JSON; a refusal is an InputError about ``source``."""
    try:
        address = urlsplit(options.api)
        if address.scheme not in ("http", "https") or not address.hostname:
            raise ValueError
        port = address.port
    except ValueError:
        mend = "write it like http://127.0.0.1:8090"
        raise InputError("--api", f"no address: {options.api!r}", mend) from None
    token = os.environ.get(_TOKEN)
    if options.token_file is not None:
        token = read_secret(options.token_file)
    headers = {} if token is None else {"Authorization": f"Bearer {token}"}
    if body is not None:
        headers["Content-Type"] = "application/json"
    kind = http.client.HTTPSConnection if address.scheme == "https" else http.client.HTTPConnection
    connection = kind(address.hostname, port, timeout=_WITHIN_S)
    try:
        text = None if body is None else json.dumps(body)
        connection.request(method, address.path.rstrip("/") + path, text, headers)
        answer = connection.getresponse()
        found = json.loads(answer.read())
    except (OSError, http.client.HTTPException) as error:
        mend = "start the dispatcher with api.port, or check the address"
        raise InputError(options.api, f"no answer: {error}", mend) from None
    except ValueError:
        raise InputError(options.api, "no API of a dispatcher", "check the address") from None
    finally:
        connection.close()
    if answer.status >= 400:
        mend = found.get("mend") or "try again later"
        raise InputError(source, str(found.get("detail")), mend, key=found.get("field"))
    return found

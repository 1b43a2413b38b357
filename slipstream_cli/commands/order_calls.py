"""`slipstream orders add|show|cancel|pin|release|settle`: orders over a dispatcher's API."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from slipstream.config import parse_json, read_secret
from slipstream.errors import InputError
from slipstream.files import read_file
from slipstream.http.client import ApiClient

_MAX_FILE_BYTES: Final = 1_000_000
_TOKEN: Final = "SLIPSTREAM_TOKEN"


def add_to(actions: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the actions."""
    adding = actions.add_parser("add", help="submit the orders of a JSON file, all or none")
    adding.add_argument("file", type=Path, help="an order as an object, or up to 1000 in a list")
    showing = actions.add_parser("show", help="an order as it is now, with its life")
    cancelling = actions.add_parser("cancel", help="cancel an order that no vehicle has left with")
    pinning = actions.add_parser("pin", help="keep an order for one vehicle in all plans to come")
    pinning.add_argument("--vehicle", help="which one (default: the one whose plan has the order)")
    releasing = actions.add_parser("release", help="let any vehicle serve an order that is pinned")
    settling = actions.add_parser("settle", help="say what became of an order")
    settled = settling.add_mutually_exclusive_group(required=True)
    settled.add_argument("--served", action="store_true", help="it was served")
    settled.add_argument(
        "--open", dest="served", action="store_false", help="it was not, and is open again"
    )
    for action in (showing, cancelling, pinning, releasing, settling):
        action.add_argument("order", help="its id")
    for action in (cancelling, pinning, releasing, settling):
        action.add_argument("--reason", help="why, for the order's history and the log")
    for action, run in (
        (adding, _add),
        (showing, _show),
        (cancelling, _cancel),
        (pinning, _pin),
        (releasing, _release),
        (settling, _settle),
    ):
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
        # Known already, and perhaps cancelled meanwhile: then it is not planned again.
        state = receipt.get("state", "open")
        away_m = receipt.get("distance_m")
        away = "" if away_m is None else f", {away_m:.0f} m from its place"
        changed = "" if state == "open" else f"  {state}"
        print(f"{receipt['order']}  at {receipt['node']}{away}{changed}")
    return 0


def _show(options: argparse.Namespace) -> int:
    print(json.dumps(_call(options, "GET", _path(options), None, options.order), indent=2))
    return 0


def _cancel(options: argparse.Namespace) -> int:
    return _change(options, "DELETE", "", {})


def _pin(options: argparse.Namespace) -> int:
    return _change(options, "POST", "/pin", {"vehicle": options.vehicle})


def _release(options: argparse.Namespace) -> int:
    return _change(options, "POST", "/release", {})


def _settle(options: argparse.Namespace) -> int:
    return _change(options, "POST", "/settle", {"served": options.served})


def _change(options: argparse.Namespace, method: str, action: str, body: dict[str, object]) -> int:
    if options.reason is not None:
        body["reason"] = options.reason
    answer = _call(options, method, _path(options) + action, body or None, options.order)
    print(f"{answer['order']}  {answer['state']}  {answer['reason']}")
    return 0


def _path(options: argparse.Namespace) -> str:
    return f"/v1/orders/{quote(options.order, safe='')}"


def _call(options: argparse.Namespace, method: str, path: str, body: object, source: str) -> Any:
    """The answer's JSON; a refusal is an InputError about ``source``."""
    token = os.environ.get(_TOKEN)
    if options.token_file is not None:
        token = read_secret(options.token_file)
    answer = ApiClient(options.api, "--api").call(method, path, body, token)
    found = answer.document
    if answer.status >= 400:
        mend = found.get("mend") or "try again later"
        raise InputError(source, str(found.get("detail")), mend, key=found.get("field"))
    return found

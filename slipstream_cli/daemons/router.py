"""`slipstream router`: a zenoh router, from the wheel that the daemons use; no other package.

It does what `zenohd --config FILE` does and tells systemd when it listens. `deploy/install.sh` also
installs this file by itself, as the unit's program: it outlives the release that it came with, and
of the package it takes only what each release has.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
from pathlib import Path
from typing import Any, Final

import zenoh

from slipstream.bus.zenoh_config import read_config
from slipstream.config import ServiceSettings
from slipstream.errors import InputError
from slipstream.service import Service

_PORT: Final = 7447
_ACCESS: Final = "access.json"


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "router",
        help="the zenoh router that all daemons connect to",
        description="Runs the zenoh router that all daemons connect to. Without a configuration it "
        "listens on 127.0.0.1 and lets every program of this machine in.",
    )
    command.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="zenoh configuration (JSON5) with users and rules, such as "
        "deploy/zenoh/router.json5 (default: none)",
    )
    command.add_argument("--port", type=int, default=_PORT, help="port on 127.0.0.1")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run until SIGTERM or SIGINT."""
    if options.config is not None and options.port != _PORT:
        raise InputError("--port", "is in the configuration", "leave one of both out")
    if not 1 <= options.port <= 65535:
        raise InputError("--port", f"{options.port} is no port", "give 1 to 65535")
    return serve(options.config, options.port)


def open_router(path: Path) -> zenoh.Session:
    """Open the router that a zenoh configuration (JSON5) describes.

    An `access.json` beside it, as `slipstream_cli.place.bus_files` makes it, adds to its rules,
    subjects and policies; of two rules or subjects with one id it has the one that counts.

    Raises:
        InputError: the file is missing or not a zenoh configuration, is not for a router, or names
            an address that cannot be listened on.
    """
    config = read_config(path)
    if config.get_json("mode") != '"router"':
        raise InputError(path, "not for a router", 'write mode: "router"', key="mode")
    _allow(config, path.with_name(_ACCESS))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        reason = str(error).split(" at ")[0]
        raise InputError(
            path, f"zenoh: {reason}", "give free addresses and readable keys"
        ) from None


def _allow(config: zenoh.Config, path: Path) -> None:
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    if not text.strip():
        return
    access = json.loads(config.get_json("access_control"))
    try:
        made = json.loads(text)
        for key in ("rules", "subjects"):
            ids = {one["id"] for one in made[key]}
            own = [one for one in access.get(key) or () if one["id"] not in ids]
            access[key] = own + made[key]
        access["policies"] = [*(access.get("policies") or ()), *made["policies"]]
        config.insert_json5("access_control", json.dumps(access))
    except (ValueError, KeyError, TypeError, zenoh.ZError) as error:
        problem = f"no rules of a router: {error!r}"
        raise InputError(path, problem, "make it anew by slipstream rsu apply") from None


def serve(config: Path | None, port: int = _PORT) -> int:
    """Route until SIGTERM or SIGINT.

    Args:
        config: of zenoh; None: this machine's programs on a port of loopback.

    Raises:
        InputError: see `open_router`; or the port is taken.
    """
    logging.basicConfig(level=logging.INFO, format="router %(levelname)s %(message)s")
    zenoh.init_log_from_env_or("warn")
    with Service("router", ServiceSettings()) as service, _router(config, port):
        service.ready()
        service.stopping.wait()
    return 0


def _router(config: Path | None, port: int) -> Any:
    if config is not None:
        return open_router(config)
    from slipstream.bus import Router

    return Router(port)


def main() -> int:
    """Run as a program of its own, by the configuration that is its argument."""
    parser = argparse.ArgumentParser(description="The zenoh router of Slipstream's daemons.")
    parser.add_argument("config", type=Path, help="zenoh configuration (JSON5)")
    try:
        return serve(parser.parse_args().config)
    except InputError as error:
        logging.error("%s", error)
        return 2


if __name__ == "__main__":
    sys.exit(main())

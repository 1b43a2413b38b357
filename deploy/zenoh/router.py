"""A zenoh router as a service, from the wheel that the daemons use: no other package is needed.

It does what `zenohd --config FILE` does and tells systemd when it listens.
"""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

import zenoh

from slipstream.config import ServiceSettings
from slipstream.errors import InputError
from slipstream.service import Service


def open_router(path: Path) -> zenoh.Session:
    """Open the router that a zenoh configuration (JSON5) describes.

    Raises:
        InputError: the file is missing or not a zenoh configuration, is not for a router, or names
            an address that cannot be listened on.
    """
    if not path.is_file():
        raise InputError(path, "no such file", "check the path")
    try:
        config = zenoh.Config.from_file(str(path))
    except zenoh.ZError as error:
        raise InputError(path, f"not a zenoh configuration: {error}", "mend the file") from None
    if config.get_json("mode") != '"router"':
        raise InputError(path, "not for a router", 'write mode: "router"', key="mode")
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        reason = str(error).split(" at ")[0]
        raise InputError(
            path, f"zenoh: {reason}", "give free addresses and readable keys"
        ) from None


def main() -> int:
    """Run until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path, help="zenoh configuration (JSON5)")
    path: Path = parser.parse_args().config
    # Of the package only what each release has: this file stays when `current` goes back to one.
    logging.basicConfig(level=logging.INFO, format="router %(levelname)s %(message)s")
    zenoh.init_log_from_env_or("warn")
    try:
        with Service("router", ServiceSettings()) as service, open_router(path):
            service.ready()
            service.stopping.wait()
    except InputError as error:
        logging.error("%s", error)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())

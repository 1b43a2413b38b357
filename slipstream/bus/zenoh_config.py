"""zenoh's configurations: of a daemon's session, and of the router inside a process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import zenoh

from slipstream.config import BusSettings, read_secret
from slipstream.errors import InputError
from slipstream.files import ending_of, read_text

RECEIVE_LIMIT_BYTES: Final = 5 * 2**20
"""Above it zenoh discards a message while it arrives, without counting it.

It is above `inbox.MAX_MESSAGE_BYTES`, so that an inbox sees and counts what is a little
too large. What a sender can make a receiver hold grows with it: as many samples of this size as a
subscription's channel has (`slipstream.bus.session`).
"""

TRANSMIT_QUEUE: Final[dict[str, int]] = {
    "transport/link/tx/queue/size/data": 16,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 50_000,
}
"""Batches of 64 KiB that wait for a link, and for how long a message waits for room, us.

zenoh drops what finds no room, and tells nobody; once one has waited in vain, the next do not wait
until there is room again. Its defaults, 2 batches and 1 ms, are overrun by 1,000 states at once.
"""

RETRY: Final = {"period_init_ms": 250, "period_max_ms": 1000}
"""Between attempts to reach a router, ms."""

_RECEIVE_LIMIT = "transport/link/rx/max_message_size"
_MAX_CONFIG_BYTES = 1_000_000


def client_config(settings: BusSettings) -> Any:
    """Configuration of a daemon's session.

    Raises:
        InputError: zenoh does not understand an endpoint or the file, or a file cannot be read.
    """
    if settings.config_file is None:
        config = _leaf_config(settings)
    else:
        config = _config_from(settings.config_file)
    if settings.user is not None and settings.password_file is not None:
        # Both at once: zenoh refuses one without the other.
        identity = {"user": settings.user, "password": read_secret(settings.password_file)}
        config.insert_json5("transport/auth/usrpwd", json.dumps(identity))
    return config


def router_config(endpoint: str) -> Any:
    """Configuration of a router that listens on one endpoint and finds nobody by itself."""
    config = zenoh.Config()
    for key, value in {
        "mode": "router",
        "listen/endpoints": [endpoint],
        "listen/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
        _RECEIVE_LIMIT: RECEIVE_LIMIT_BYTES,
        **TRANSMIT_QUEUE,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _leaf_config(settings: BusSettings) -> Any:
    config = zenoh.Config()
    for key, value in {
        # A client's open() blocks until a router answers, and a router does not pass messages
        # between peers; a router that listens nowhere is a leaf that does neither.
        "mode": "router",
        "listen/endpoints": [],
        "connect/endpoints": list(settings.connect),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": RETRY,
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
        # It locks memory, which a sandboxed service may not, and a process that is killed leaves
        # 18 MB in /dev/shm.
        "transport/shared_memory/enabled": False,
        _RECEIVE_LIMIT: RECEIVE_LIMIT_BYTES,
        **TRANSMIT_QUEUE,
    }.items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError:
            raise InputError(
                "bus", f"{value!r} is not understood", "give tcp/HOST:PORT", key="connect"
            ) from None
    return config


def _config_from(path: Path) -> Any:
    config = read_config(path)
    limit = min(RECEIVE_LIMIT_BYTES, int(config.get_json(_RECEIVE_LIMIT)))
    config.insert_json5(_RECEIVE_LIMIT, json.dumps(limit))
    return config


def read_config(path: Path) -> zenoh.Config:
    """Read a zenoh configuration: JSON5, or YAML by the file's ending.

    Raises:
        InputError: the file is missing, too large, or no zenoh configuration.
    """
    text = read_text(path, _MAX_CONFIG_BYTES)
    try:
        if ending_of(path) in (".yaml", ".yml"):
            return zenoh.Config.from_file(str(path))
        return zenoh.Config.from_json5(text)
    except zenoh.ZError as error:
        raise InputError(path, f"not a zenoh configuration: {error}", "mend the file") from None

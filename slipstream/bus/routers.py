"""Why a session has no router: nobody listens there, or the router does not let it in."""

from __future__ import annotations

import json
import re
import socket
from collections.abc import Sequence
from typing import Any, Final

_PROBE_S: Final = 0.5
_OVER_TCP: Final = re.compile(r"(?:tcp|tls|ws)/(?P<host>[^#?]+):(?P<port>\d+)(?:[#?].*)?")


def endpoints_of(config: Any) -> tuple[str, ...]:
    """Endpoints that a zenoh configuration connects to; it may have them by mode."""
    found = json.loads(config.get_json("connect/endpoints"))
    groups = found.values() if isinstance(found, dict) else (found,)
    return tuple(str(one) for group in groups for one in group or ())


def why_unconnected(endpoints: Sequence[str]) -> str:
    """Why a session that is not connected is not, in words.

    A router closes a session with a wrong user, password or certificate and says nothing; so that
    somebody listens at its port is what tells it from one that is gone.
    """
    where = ", ".join(endpoints)
    found = listening(endpoints)
    if found:
        return (
            f"a router listens at {', '.join(found)} and does not let it in: its user, "
            "password or certificate is not one of the router's"
        )
    return f"no router answers at {where}" if where else "no router answers"


def listening(endpoints: Sequence[str]) -> tuple[str, ...]:
    """Endpoints at which somebody takes connections."""
    return tuple(one for one in endpoints if _listens(one))


def _listens(endpoint: str) -> bool:
    """Whether somebody takes connections; of a protocol without any it is not known."""
    read = _OVER_TCP.fullmatch(endpoint)
    if read is None:
        return False
    try:
        with socket.create_connection((read["host"].strip("[]"), int(read["port"])), _PROBE_S):
            return True
    except (OSError, OverflowError, UnicodeError):
        return False

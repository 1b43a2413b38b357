"""The dispatcher's HTTP API: orders in, vehicles, plans, cycles and segments out.

Names are loaded on demand: the dispatcher announces events before it has loaded the web framework,
which takes a second.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from slipstream.on_demand import on_demand

if TYPE_CHECKING:
    from dispatcher_daemon.service.api.app import create_app
    from dispatcher_daemon.service.api.auth import SCOPES, Token, TokenList, token_hash
    from dispatcher_daemon.service.api.hub import EventHub
    from dispatcher_daemon.service.api.server import ApiServer
    from dispatcher_daemon.service.api.services import Services
    from slipstream.http.rate import RateLimit

__all__ = [
    "SCOPES",
    "ApiServer",
    "EventHub",
    "RateLimit",
    "Services",
    "Token",
    "TokenList",
    "create_app",
    "token_hash",
]

# Light modules first.
__getattr__ = on_demand(__name__, __all__, "hub auth services server app")

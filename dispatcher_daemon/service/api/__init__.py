"""The dispatcher's HTTP API: orders in, vehicles, plans, cycles and segments out."""

from __future__ import annotations

from dispatcher_daemon.service.api.app import create_app
from dispatcher_daemon.service.api.auth import SCOPES, Token, TokenList, token_hash
from dispatcher_daemon.service.api.server import ApiServer
from dispatcher_daemon.service.api.services import Services
from slipstream.http.rate import RateLimit

__all__ = [
    "SCOPES",
    "ApiServer",
    "RateLimit",
    "Services",
    "Token",
    "TokenList",
    "create_app",
    "token_hash",
]

"""Who a caller is and what it may do: bearer tokens with scopes, from a file of their hashes."""

from __future__ import annotations

import hashlib
import hmac
import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Self, get_args
from urllib.parse import urlsplit

from fastapi import Depends, Request, Security
from fastapi.security import HTTPBearer
from pydantic import Field, model_validator
from starlette.datastructures import Headers

from dispatcher_daemon.settings import Scope
from slipstream.config import Settings, credential_path, load
from slipstream.errors import InputError
from slipstream.http.problems import Problem
from slipstream.messages import Identifier
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

SCOPES: Final[tuple[Scope, ...]] = get_args(Scope)

_CHALLENGE: Final = {"WWW-Authenticate": 'Bearer realm="slipstream"'}
_MEND: Final = "send 'Authorization: Bearer TOKEN'; `slipstream token new` makes one"
_FORWARDED: Final = ("forwarded", "x-forwarded-for", "x-forwarded-host", "x-real-ip")
_BEARER: Final = HTTPBearer(
    auto_error=False, description="A token of the file that api.tokens names."
)


class Token(Settings):
    """A caller's token, as the file has it."""

    name: Identifier
    sha256: str = Field(pattern="^[0-9a-f]{64}$", description="Of the token, hexadecimal.")
    scopes: tuple[Scope, ...] = Field(min_length=1, description="What its caller may do.")


class TokenList(Settings):
    """The file of tokens."""

    tokens: tuple[Token, ...] = ()

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        for name, count in Counter(token.name for token in self.tokens).items():
            if count > 1:
                raise ValueError(f"{count} tokens are named {name!r}; rename one")
        return self


class TokenFile:
    """The tokens of a file, read again whenever it has changed. One that is gone or faulty later
    has no tokens, and the log says so.

    Args:
        path: a plain name is first looked for among systemd's credentials.

    Raises:
        InputError: the file is missing or faulty.
    """

    def __init__(self, path: Path) -> None:
        self._path = credential_path(path)
        self._tokens = load(self._path, TokenList).tokens
        self._stamp = self._stamp_now()
        self._limiter = LogLimiter()

    def current(self) -> tuple[Token, ...]:
        """The tokens now."""
        stamp = self._stamp_now()
        if stamp != self._stamp:
            self._stamp = stamp
            try:
                self._tokens = load(self._path, TokenList).tokens
            except InputError as error:
                self._tokens = ()
                if self._limiter.allow("tokens"):
                    log.warning("no token is accepted: %s", error)
        return self._tokens

    def _stamp_now(self) -> tuple[int, int, int] | None:
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_size, found.st_ino


@dataclass(frozen=True)
class Client:
    """Who sent a request.

    Attributes:
        name: of its token; None: it sent none.
    """

    name: str | None
    scopes: frozenset[Scope]


def token_hash(token: bytes) -> str:
    """What the file has of a token."""
    return hashlib.sha256(token).hexdigest()


def identify(headers: Headers, tokens: tuple[Token, ...] | None) -> Client:
    """The sender of a request.

    Args:
        tokens: that count; None: there is no file of tokens. Then callers of this machine may
            read, but for those that a proxy or a foreign page's name leads here.

    Raises:
        Problem: 401: a token is needed, or the one that was sent does not count.
    """
    sent = headers.getlist("authorization")
    if not sent and tokens is None:
        if not _is_local(headers):
            raise _unauthorised("without a token only this machine's own names are served")
        return Client(None, frozenset({"read"}))
    if len(sent) != 1:
        raise _unauthorised("a token is needed" if not sent else "two Authorization headers")
    scheme, _, secret = sent[0].partition(" ")
    if scheme.lower() != "bearer" or not secret.strip():
        raise _unauthorised("the Authorization header has no bearer token")
    hashed = token_hash(secret.strip().encode("latin-1"))
    # Each is compared, in constant time: how long it takes tells nothing about any of them.
    found = [token for token in tokens or () if hmac.compare_digest(token.sha256, hashed)]
    if not found:
        raise _unauthorised("the token is not known")
    return Client(found[0].name, frozenset(found[0].scopes))


def requires(scope: Scope) -> Any:
    """A dependency for a router or an operation: its caller needs this scope."""

    def check(request: Request, _bearer: Annotated[object, Security(_BEARER)]) -> None:
        client: Client = request.state.client
        if scope in client.scopes:
            return
        if client.name is None:
            raise _unauthorised(f"a token with the scope {scope!r} is needed")
        raise Problem(
            403,
            f"the token {client.name!r} has not the scope {scope!r}",
            "use a token that has it",
            field="Authorization",
        )

    dependency: Callable[..., None] = check
    return Depends(dependency)


def _unauthorised(detail: str) -> Problem:
    return Problem(401, detail, _MEND, field="Authorization", headers=_CHALLENGE)


def _is_local(headers: Headers) -> bool:
    """Whether a request came to this machine by its loopback name, and straight."""
    if any(name in headers for name in _FORWARDED):
        return False
    try:
        name = urlsplit(f"//{headers.get('host', '')}").hostname
    except ValueError:
        return False
    return name in ("localhost", "127.0.0.1", "::1")

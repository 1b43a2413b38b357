"""Exceptions of IBM's client as `ServiceFault`s without the token."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from dispatcher_daemon.solvers.quantum.backends.jobs import FaultKind, ServiceFault
from slipstream.errors import InputError

T = TypeVar("T")

MAX_LINE_LENGTH = 300


def ask(token: str, do: Callable[[], T]) -> T:
    """Call IBM's client.

    The fault carries no cause: the client's exceptions hold the request with its headers.

    Args:
        token: to be left out of every line.
        do: the call.

    Raises:
        InputError: as ``do`` raises it.
        ServiceFault: in place of everything else.
    """
    try:
        return do()
    except (InputError, ServiceFault):
        raise
    except Exception as error:
        fault = fault_of(error, token)
    raise fault


def fault_of(error: BaseException, token: str) -> ServiceFault:
    """The fault behind an exception, from the HTTP answer in its chain of causes if there is one.

    An exception that has no HTTP answer in its chain, nor is of IBM's client, comes from reading
    an answer of the wrong shape.
    """
    from qiskit.exceptions import QiskitError

    line = f"IBM Quantum: {without_secrets(str(error), token) or type(error).__name__}"
    links = list(_chain(error))
    status = next((s for s in map(_status, links) if s is not None), None)
    if status is not None:
        wait_s = next((w for w in map(_retry_s, links) if w is not None), None)
        return ServiceFault(_kind_of_status(status), line, wait_s)
    kind = next((k for k in map(_kind_of_failure, links) if k is not None), None)
    if kind is None:
        kind = "broken" if isinstance(error, QiskitError) else "garbage"
    return ServiceFault(kind, line)


def without_secrets(text: str, token: str) -> str:
    """One line of at most `MAX_LINE_LENGTH` characters, without the token or a bearer's."""
    line = " ".join(text.split())
    if token:
        line = line.replace(token, "…")
    return re.sub(r"(?i)\b(bearer|apikey)\s+[^\s'\"\\]+", r"\1 …", line)[:MAX_LINE_LENGTH]


def _chain(error: BaseException) -> Iterator[BaseException]:
    seen: set[int] = set()
    link: BaseException | None = error
    while link is not None and id(link) not in seen:
        seen.add(id(link))
        yield link
        link = link.__cause__ or link.__context__


def _status(error: BaseException) -> int | None:
    """HTTP status of the answer that an exception is about."""
    response = getattr(error, "response", None)
    for source in (getattr(response, "status_code", None), getattr(error, "status_code", None)):
        if isinstance(source, int) and source >= 400:
            return source
    return None


def _kind_of_status(status: int) -> FaultKind:
    if status == 429:
        return "limited"
    return "broken" if status >= 500 else "refused"


def _kind_of_failure(error: BaseException) -> FaultKind | None:
    import requests
    from qiskit_ibm_runtime.exceptions import IBMNotAuthorizedError

    if isinstance(error, IBMNotAuthorizedError):
        return "refused"
    if isinstance(error, (requests.Timeout, requests.ConnectionError, TimeoutError)):
        return "unreachable"
    if isinstance(error, json.JSONDecodeError):
        return "garbage"
    return None


def _retry_s(error: Any) -> float | None:
    """Seconds in the answer's Retry-After header."""
    headers = getattr(getattr(error, "response", None), "headers", None) or {}
    try:
        wait_s = float(headers.get("Retry-After", ""))
    except ValueError:
        return None
    return wait_s if 0 <= wait_s < 1e6 else None

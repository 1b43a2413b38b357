"""Calls of the dispatcher's HTTP API."""

from __future__ import annotations

import http.client
import json
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

from slipstream.errors import InputError

WITHIN_S: Final = 30.0
MAX_ANSWER_BYTES: Final = 64_000_000


@dataclass(frozen=True)
class Answer:
    """What the API answers.

    Attributes:
        status: of HTTP.
        document: the JSON object; that of a refusal has `detail`, and may have `mend` and `field`.
    """

    status: int
    document: dict[str, Any]


@dataclass(frozen=True)
class ApiClient:
    """The API at an address.

    Args:
        address: such as http://127.0.0.1:8090.
        source: what errors of the address name: its option or setting.

    Raises:
        InputError: it is no address.
    """

    address: str
    source: str

    def __post_init__(self) -> None:
        try:
            parts = urlsplit(self.address)
            is_usable = parts.scheme in ("http", "https") and bool(parts.hostname)
            is_usable = is_usable and (parts.port is None or parts.port > 0)
        except ValueError:
            is_usable = False
        if not is_usable:
            mend = "write it like http://127.0.0.1:8090"
            raise InputError(self.source, f"no address: {self.address!r}", mend)

    def call(
        self,
        method: str,
        path: str,
        body: object = None,
        token: str | None = None,
        within_s: float = WITHIN_S,
    ) -> Answer:
        """Send one request; blocks.

        Args:
            path: below the address, with its parts quoted.
            within_s: limit of each wait for the other side, s.

        Raises:
            InputError: nobody answers, or something that is no API of a dispatcher.
        """
        parts = urlsplit(self.address)
        assert parts.hostname is not None
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        if body is not None:
            headers["Content-Type"] = "application/json"
        secure = parts.scheme == "https"
        kind = http.client.HTTPSConnection if secure else http.client.HTTPConnection
        connection = kind(parts.hostname, parts.port, timeout=within_s)
        try:
            text = None if body is None else json.dumps(body)
            connection.request(method, parts.path.rstrip("/") + path, text, headers)
            answer = connection.getresponse()
            document = json.loads(answer.read(MAX_ANSWER_BYTES))
        except (OSError, http.client.HTTPException) as error:
            mend = "start the dispatcher with api.port, or check the address"
            raise InputError(self.address, f"no answer: {error}", mend) from None
        except ValueError:
            document = None
        finally:
            connection.close()
        if not isinstance(document, dict):
            raise InputError(self.address, "no API of a dispatcher", "check the address")
        return Answer(answer.status, document)

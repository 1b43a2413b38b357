"""The base of all messages: units, identifiers, encoding, decoding."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Annotated, Any, Final, TypeVar
from urllib.parse import quote

from prometheus_client import Counter
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails, from_json, to_json

from slipstream.errors import InputError

ROOT: Final = "slipstream/v1"
SCHEMA: Final = "1.0"
"""Version of all messages, MAJOR.MINOR; a message without one is of 1.0.

From the next release on a new field with a default makes a new minor version, which older receivers
read as far as they know it; anything else makes a new major version, and a new `ROOT`.
"""
ENCODING: Final = f"application/json;version={SCHEMA}"
"""zenoh's encoding of each message: its format and, as the suffix, its version. Receivers of 0.1.0
do not look at it; a field in the payload they would refuse.
"""

_MAJOR, _MINOR = (int(part) for part in SCHEMA.split("."))
_MARK: Final = "application/json;version="
_VERSION: Final = re.compile(r"(0|[1-9][0-9]{0,5})\.(0|[1-9][0-9]{0,5})")
_OPENING: Final = b'{"schema":"%b",' % SCHEMA.encode()
# Receivers of 0.1.0 refuse the field, so only minor versions that they cannot read anyway have it:
# what is stored or handed on without its encoding is still read as far as it is known.
_SENT: Final = b"{" if _MINOR == 0 else _OPENING
_MAX_UNKNOWN_FIELDS: Final = 1000

UNKNOWN_FIELDS = Counter(
    "slipstream_bus_unknown_fields",
    "Fields left out of messages of a newer minor schema version, by message.",
    ["message"],
)

Identifier = Annotated[str, Field(min_length=1, max_length=200)]
"""A name of an RSU, road segment, vehicle or order; any characters, percent-encoded in keys."""

TimeNs = Annotated[int, Field(ge=0, lt=2**63)]
Count = Annotated[int, Field(ge=0, lt=2**63)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]


class Message(BaseModel):
    """Base of everything on the bus."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    def to_bytes(self) -> bytes:
        """Encode as UTF-8 JSON; above 1.0 with the schema version as the first field."""
        return _SENT + self.model_dump_json()[1:].encode()


M = TypeVar("M", bound=Message)


def decode(model: type[M], payload: bytes, source: str) -> M:
    """Read one message of this major version.

    Of a newer minor version unknown fields are left out and counted; of others they are refused.

    Args:
        model: the message type that the key promises.
        payload: UTF-8 JSON.
        source: the key it came on, for the error line.

    Raises:
        InputError: the payload is not such a message.
    """
    try:
        if payload.startswith(_OPENING):
            return model.model_validate_json(b"{" + payload[len(_OPENING) :])
        if b'"schema"' not in payload:
            return model.model_validate_json(payload)
        return _decode_other(model, payload, source)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise _refusal(model, source, first["msg"], _path(first)) from None


def _decode_other(model: type[M], payload: bytes, source: str) -> M:
    """Read a message whose version has to be looked for."""
    try:
        content = from_json(payload)
    except ValueError as error:
        raise _refusal(model, source, str(error), None) from None
    if not isinstance(content, dict) or "schema" not in content:
        return model.model_validate_json(payload)
    minor = take_minor(content, model, source)
    try:
        return _validated(model, content)
    except ValidationError as error:
        if minor <= _MINOR or not _leave_unknown_out(content, error):
            raise
        known = _validated(model, content)
        UNKNOWN_FIELDS.labels(model.__name__).inc(error.error_count())
        return known


def take_minor(content: dict[str, Any], model: type[Message], source: str) -> int:
    """Take the schema version off a message's fields; its minor part, 0 without one.

    Args:
        content: the fields; `schema` is removed.
        model: for the error line.
        source: likewise.

    Raises:
        InputError: it is no version, or one of another major version.
    """
    if "schema" not in content:
        return 0
    version = content.pop("schema")
    parts = _VERSION.fullmatch(version) if isinstance(version, str) else None
    if parts is None:
        raise _refusal(model, source, "not a version as MAJOR.MINOR", "schema")
    if int(parts[1]) != _MAJOR:
        raise InputError(
            source,
            f"a {model.__name__} of schema {version}, where {SCHEMA} is read",
            "bring sender and receiver to one version",
            key="schema",
        )
    return int(parts[2])


def versioned(encoding: str, payload: bytes) -> bytes:
    """A payload as `decode` reads it: a newer minor version of its encoding stands in it too.

    Args:
        encoding: zenoh's, of the sample; without a version it says nothing of the payload.
        payload: of the sample.

    Raises:
        ValueError: the encoding has another major version, or one that is none.
    """
    if not encoding.startswith(_MARK):
        return payload
    version = encoding[len(_MARK) :]
    parts = _VERSION.fullmatch(version)
    if parts is None or int(parts[1]) != _MAJOR:
        raise ValueError(f"schema {version[:20]!r}, where {SCHEMA} is read")
    if int(parts[2]) <= _MINOR or not payload.startswith(b"{") or b'"schema"' in payload:
        return payload
    return b'{"schema":"%b",' % version.encode() + payload[1:]


def _validated(model: type[M], content: object) -> M:
    # By way of JSON: its strict rules take a list for a tuple.
    return model.model_validate_json(to_json(content, inf_nan_mode="constants"))


def _leave_unknown_out(content: Any, error: ValidationError) -> bool:
    """Remove the unknown fields; False if something else is wrong too."""
    if error.error_count() > _MAX_UNKNOWN_FIELDS:
        return False
    found = error.errors(include_url=False, include_input=False, include_context=False)
    if any(fault["type"] != "extra_forbidden" for fault in found):
        return False
    for fault in found:
        *way, name = fault["loc"]
        place = content
        for part in way:
            place = place[part]
        del place[name]
    return True


def _path(fault: ErrorDetails) -> str | None:
    return ".".join(str(part) for part in fault["loc"]) or None


def _refusal(model: type[Message], source: str, problem: str, key: str | None) -> InputError:
    return InputError(
        source, f"not a {model.__name__}: {problem}", "check the sender's version", key=key
    )


@lru_cache(maxsize=16_384)
def chunk(name: str) -> str:
    """One chunk of a key expression: percent-encoded, as zenoh forbids ``* $ ? # /`` in chunks."""
    return quote(name, safe="")

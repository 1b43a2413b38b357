"""The base of all messages: units, identifiers, encoding, decoding."""

from __future__ import annotations

import re
from functools import cache, lru_cache
from typing import Annotated, Any, Final, Protocol, Self, TypeVar, get_args, runtime_checkable
from urllib.parse import quote

import msgspec
from msgspec import Meta
from prometheus_client import Counter
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import CoreSchema, ErrorDetails, core_schema, from_json, to_json

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

_MAX_INT: Final = 2**63 - 1

# `Field` is for a `Model`, `Meta` for a `Compact`.
Identifier = Annotated[str, Field(min_length=1, max_length=200), Meta(min_length=1, max_length=200)]
"""A name of an RSU, road segment, vehicle or order; any characters, percent-encoded in keys."""

TimeNs = Annotated[int, Field(ge=0, lt=2**63), Meta(ge=0, le=_MAX_INT)]
Count = Annotated[int, Field(ge=0, lt=2**63), Meta(ge=0, le=_MAX_INT)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False), Meta(ge=0)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False), Meta(gt=0)]
Share = Annotated[float, Field(ge=0, le=1), Meta(ge=0, le=1)]


@runtime_checkable
class Message(Protocol):
    """Anything on the bus: a `Model` or a `Compact`."""

    @classmethod
    def read(cls, payload: bytes) -> Self:
        """Read one from JSON without a schema version; a ValueError says why it is none."""
        ...

    def to_bytes(self) -> bytes:
        """Encode as UTF-8 JSON; above 1.0 with the schema version as the first field."""
        ...


class Model(BaseModel):
    """Base of messages; values are checked wherever one is made."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @classmethod
    def read(cls, payload: bytes) -> Self:
        """See `Message`."""
        return cls.model_validate_json(payload)

    def to_bytes(self) -> bytes:
        """See `Message`."""
        return _SENT + self.model_dump_json()[1:].encode()


class Compact(msgspec.Struct, frozen=True, forbid_unknown_fields=True, gc=False):
    """Base of messages that come by the ten thousand a second, and of their parts.

    One is read in a tenth of a `Model`'s time and kept in a sixth of its memory. Its values are
    checked where it is read and where it is sent.
    """

    @classmethod
    def read(cls, payload: bytes) -> Self:
        """See `Message`."""
        found: Self = _decoder(cls).decode(payload)
        return found

    def to_bytes(self) -> bytes:
        """See `Message`.

        Raises:
            ValueError: it has a value that its readers would refuse.
        """
        payload = msgspec.json.encode(self)
        self.read(payload)
        return _SENT + payload[1:]

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: object) -> CoreSchema:
        """Within a `BaseModel`: an object of this class, written by its fields."""
        return core_schema.is_instance_schema(
            cls,
            ref=f"{cls.__module__}.{cls.__qualname__}",
            serialization=core_schema.plain_serializer_function_ser_schema(msgspec.to_builtins),
        )

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: object, handler: object) -> dict[str, Any]:
        """Whole, without references to other places of the document."""
        described = msgspec.json.schema(cls)
        parts = described.pop("$defs")
        whole: dict[str, Any] = _without_references(described, parts)
        return whole


M = TypeVar("M", bound=Message)
C = TypeVar("C", bound=Compact)


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
            return model.read(b"{" + payload[len(_OPENING) :])
        if b'"schema"' not in payload:
            return model.read(payload)
        return _decode_other(model, payload, source)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise _refusal(model, source, first["msg"], _path(first)) from None
    except ValueError as error:
        # msgspec's "Expected `float` >= 0.0 - at `$.features.mean_gap_m.standard_error`".
        problem, _, place = str(error).partition(" - at `$")
        raise _refusal(model, source, problem, place.strip(".`") or None) from None


@cache
def _decoder(model: type[C]) -> msgspec.json.Decoder[C]:
    return msgspec.json.Decoder(model)


def _decode_other(model: type[M], payload: bytes, source: str) -> M:
    """Read a message whose version has to be looked for."""
    try:
        content = from_json(payload)
    except ValueError as error:
        raise _refusal(model, source, str(error), None) from None
    if not isinstance(content, dict) or "schema" not in content:
        return model.read(payload)
    minor = take_minor(content, model, source)
    if issubclass(model, Compact):
        unknown = _leave_out(model, content) if minor > _MINOR else 0
        if unknown > _MAX_UNKNOWN_FIELDS:
            raise _refusal(model, source, f"{unknown} unknown fields", None)
        UNKNOWN_FIELDS.labels(model.__name__).inc(unknown)
        return _validated(model, content)
    try:
        return _validated(model, content)
    except ValidationError as error:
        if minor <= _MINOR or not _leave_unknown_out(content, error):
            raise
        known = _validated(model, content)
        UNKNOWN_FIELDS.labels(model.__name__).inc(error.error_count())
        return known


def take_minor(content: dict[str, Any], model: type[object], source: str) -> int:
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
    return model.read(to_json(content, inf_nan_mode="constants"))


def _leave_out(kind: type[Compact], content: dict[str, Any]) -> int:
    """Remove fields that a Compact does not have, and its parts do not; how many."""
    known = {field.name: field.type for field in msgspec.structs.fields(kind)}
    unknown = content.keys() - known
    for name in unknown:
        del content[name]
    count = len(unknown)
    for name, value in content.items():
        for inner in (known[name], *get_args(known[name])):
            if isinstance(value, dict) and isinstance(inner, type) and issubclass(inner, Compact):
                count += _leave_out(inner, value)
    return count


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


def _without_references(schema: Any, parts: dict[str, Any]) -> Any:
    """A JSON schema with its parts in place of references to them."""
    if isinstance(schema, list):
        return [_without_references(one, parts) for one in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        schema = parts[schema["$ref"].rpartition("/")[2]] | {
            key: value for key, value in schema.items() if key != "$ref"
        }
    return {key: _without_references(value, parts) for key, value in schema.items()}


def _path(fault: ErrorDetails) -> str | None:
    return ".".join(str(part) for part in fault["loc"]) or None


def _refusal(model: type[object], source: str, problem: str, key: str | None) -> InputError:
    return InputError(
        source, f"not a {model.__name__}: {problem}", "check the sender's version", key=key
    )


@lru_cache(maxsize=16_384)
def chunk(name: str) -> str:
    """One chunk of a key expression: percent-encoded, as zenoh forbids ``* $ ? # /`` in chunks."""
    return quote(name, safe="")

"""The base of all messages: units, identifiers, encoding, decoding."""

from __future__ import annotations

import inspect
from functools import cache, lru_cache
from typing import Annotated, Any, Final, Protocol, Self, TypeVar, runtime_checkable
from urllib.parse import quote

import msgspec
from msgspec import Meta
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import CoreSchema, ErrorDetails, core_schema

from slipstream.errors import InputError

SCHEMA: Final = 1
"""Version of all messages, of one release. A message of another one is refused."""
ROOT: Final = f"slipstream/v{SCHEMA}"
_MARK: Final = "application/json;version="
ENCODING: Final = f"{_MARK}{SCHEMA}"
"""zenoh's encoding of each message: its format and, as the suffix, its version."""

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
        """Read one from JSON; a ValueError says why it is none."""
        ...

    def to_bytes(self) -> bytes:
        """Encode as UTF-8 JSON."""
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
        return self.model_dump_json().encode()


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
        return payload

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
    """Read one message; unknown fields are refused.

    Args:
        model: the message type that the key promises.
        source: the key it came on, for the error line.

    Raises:
        InputError: the payload is not such a message.
    """
    try:
        return model.read(payload)
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


def check_version(encoding: str) -> None:
    """Check the version in a sample's encoding; without one it says nothing.

    Raises:
        ValueError: it is another version than `SCHEMA`.
    """
    version = encoding.removeprefix(_MARK)
    if version != encoding and version != str(SCHEMA):
        raise ValueError(f"schema {version[:20]!r}, where {SCHEMA} is read")


def _without_references(schema: Any, parts: dict[str, Any]) -> Any:
    """A JSON schema with its parts in place of references to them, docstrings without their
    indentation, which msgspec before 0.23 leaves in.
    """
    if isinstance(schema, list):
        return [_without_references(one, parts) for one in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        schema = parts[schema["$ref"].rpartition("/")[2]] | {
            key: value for key, value in schema.items() if key != "$ref"
        }
    return {
        key: inspect.cleandoc(value)
        if key == "description" and isinstance(value, str)
        else _without_references(value, parts)
        for key, value in schema.items()
    }


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

"""The base of all messages: units, identifiers, encoding, decoding."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Final, TypeVar
from urllib.parse import quote

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from slipstream.errors import InputError

SCHEMA: Final = 1
"""Version of all messages, of one release. A message of another one is refused."""
ROOT: Final = f"slipstream/v{SCHEMA}"
_MARK: Final = "application/json;version="
ENCODING: Final = f"{_MARK}{SCHEMA}"
"""zenoh's encoding of each message: its format and, as the suffix, its version."""

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
        """Encode as UTF-8 JSON."""
        return self.model_dump_json().encode()


M = TypeVar("M", bound=Message)


def decode(model: type[M], payload: bytes, source: str) -> M:
    """Read one message; unknown fields are refused.

    Args:
        model: the message type that the key promises.
        payload: UTF-8 JSON.
        source: the key it came on, for the error line.

    Raises:
        InputError: the payload is not such a message.
    """
    try:
        return model.model_validate_json(payload)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise InputError(
            source,
            f"not a {model.__name__}: {first['msg']}",
            "check the sender's version",
            key=_path(first),
        ) from None


def check_version(encoding: str) -> None:
    """Check the version in a sample's encoding; without one it says nothing.

    Raises:
        ValueError: it is another version than `SCHEMA`.
    """
    version = encoding.removeprefix(_MARK)
    if version != encoding and version != str(SCHEMA):
        raise ValueError(f"schema {version[:20]!r}, where {SCHEMA} is read")


def _path(fault: ErrorDetails) -> str | None:
    return ".".join(str(part) for part in fault["loc"]) or None


@lru_cache(maxsize=16_384)
def chunk(name: str) -> str:
    """One chunk of a key expression: percent-encoded, as zenoh forbids ``* $ ? # /`` in chunks."""
    return quote(name, safe="")

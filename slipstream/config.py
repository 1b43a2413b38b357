"""Settings files and bodies of requests: TOML or JSON is read and validated here only.

Bodies may be anything: hostile ones end in an InputError as mistaken ones do.
"""

from __future__ import annotations

import difflib
import json
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, Self, TypeVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import CoreSchema, ErrorDetails

from slipstream.errors import MAX_FAULTS, InputError
from slipstream.files import ending_of, read_text, text_of
from slipstream.plain_words import words_of

DEMO_NETWORK: Final = "demo"
"""Name of the network that comes along; see `slipstream.roads.sumo_net`."""


def _stop_at_first_faulty_row(schema: Any) -> None:
    if isinstance(schema, dict):
        if schema.get("type") in ("list", "tuple"):
            schema["fail_fast"] = True
        schema = list(schema.values())
    if isinstance(schema, list):
        for part in schema:
            _stop_at_first_faulty_row(part)


class Settings(BaseModel):
    """Base of all settings: unknown keys are refused.

    Attributes:
        constants: fields that no site.toml sets; tests and the laboratory give them.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    constants: ClassVar[frozenset[str]] = frozenset()

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        # Of a million faulty rows the first one is told; the faults of all would fill the memory.
        schema = handler(source)
        _stop_at_first_faulty_row(schema)
        return schema


class TunedSettings(Settings):
    """Settings that hold numbers which are no operator's decision: fields without a description
    are constants.
    """

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Note the constants."""
        cls.constants = frozenset(
            name for name, field in cls.model_fields.items() if not field.description
        )


S = TypeVar("S", bound=Settings)
T = TypeVar("T")
M = TypeVar("M", bound=BaseModel)

MAX_TOML_BYTES: Final = 2_000_000
MAX_JSON_BYTES: Final = 8_000_000
MAX_JSON_LISTS: Final = 500_000
"""Lists and objects of one file."""

_MAX_SECRET_BYTES: Final = 10_000
_NUL: Final = re.compile(r"(?<!\\)(?:\\\\)*\\u0000")

_UNKNOWN_KEY: Final = ("extra_forbidden", "unexpected_keyword_argument")
_MEND_UNKNOWN: Final = "remove it or mend its spelling"
_NAMING: Final = ("id", "segment", "vehicle")
"""Keys that name a table in a list."""


class SiteBus(Settings):
    """How a site's daemons reach each other over zenoh (``[bus]``)."""

    connect: tuple[str, ...] = Field(
        default=("tcp/127.0.0.1:7447",), description="Endpoints of the zenoh router."
    )
    config_file: Path | None = Field(
        default=None,
        description="A zenoh configuration (JSON5) used instead: for TLS or several sites.",
    )
    password_file: Path | None = Field(
        default=None,
        description="File with the daemon's password; a plain name is first looked for among "
        "systemd's credentials. The router knows the daemons as `dispatcher`, `dashboard`, "
        "`edge-NAME` and `agent-NAME`.",
    )


class BusSettings(SiteBus):
    """How one daemon reaches the others over zenoh."""

    user: str | None = Field(
        default=None,
        pattern=r"^[^:\s]+$",
        description="Name that the router knows this daemon by; with `password_file`.",
    )

    @model_validator(mode="after")
    def _user_has_password(self) -> Self:
        if (self.user is None) != (self.password_file is None):
            raise ValueError("user and password_file go together; give both or none")
        return self


class SiteService(Settings):
    """Logs and traces of all daemons (``[service]``)."""

    log_level: str = Field(
        default="INFO",
        pattern="^(DEBUG|INFO|WARNING|ERROR)$",
        description="Lowest level of messages that are logged.",
    )
    log_format: Literal["text", "json"] = Field(
        default="text",
        description="Of log lines: `json` is one object a line, with time, level, daemon, message "
        "and, for a fault, exception.",
    )
    traces: str | None = Field(
        default=None,
        pattern=r"^https?://[^\s/]+(/\S*)?$",
        description="Collector that OpenTelemetry traces are sent to (OTLP over HTTP), such as "
        "`http://127.0.0.1:4318`; needs slipstream[tracing].",
    )


class ServiceSettings(SiteService):
    """Logs, traces and metrics of one daemon."""

    metrics_port: int = Field(
        default=0, ge=0, le=65535, description="Prometheus metrics on 127.0.0.1; 0: not served."
    )


def credential_path(path: Path) -> Path:
    """Where a file for one service is.

    A plain name is first looked for in ``$CREDENTIALS_DIRECTORY``, where systemd puts such files.
    """
    folder = os.environ.get("CREDENTIALS_DIRECTORY")
    if folder and path.name == str(path) and (Path(folder) / path).exists():
        return Path(folder) / path
    return path


def read_secret(path: Path) -> str:
    """The text of a file with a secret, without blanks at its ends; see `credential_path`.

    Raises:
        InputError: the file is missing, not readable or empty.
    """
    path = credential_path(path)
    secret = read_text(path, _MAX_SECRET_BYTES).strip()
    if not secret:
        raise InputError(path, "empty", "write the secret into it")
    return secret


def read_toml(path: Path) -> dict[str, object]:
    """Read a TOML file.

    Raises:
        InputError: the file is missing, not readable or not TOML.
    """
    return _parsed(read_text(path, MAX_TOML_BYTES, "TOML"), tomllib.loads, "TOML", path)


def read_data(path: Path) -> object:
    """Read a JSON file, by its suffix, or else a TOML file.

    Raises:
        InputError: as `read_toml`, for JSON likewise; also a key that one object has twice.
    """
    return read_json(path) if ending_of(path) == ".json" else read_toml(path)


def read_json(path: Path) -> object:
    """Read a JSON file.

    Raises:
        InputError: as `read_data`.
    """
    return _parsed(read_text(path, MAX_JSON_BYTES, "JSON"), _parse_json, "JSON", path)


def parse_json(data: bytes, source: str | Path) -> object:
    """Read JSON that did not come as a file.

    Raises:
        InputError: as `read_data`.
    """
    return _parsed(text_of(data, source, "JSON"), _parse_json, "JSON", source)


def _parsed(text: str, parse: Callable[[str], T], form: str, source: str | Path) -> T:
    mend = "mend the file" if isinstance(source, Path) else f"mend the {source}"
    try:
        return parse(text)
    except RecursionError:
        raise InputError(source, "nested too deeply", mend) from None
    except ValueError as error:
        raise InputError(source, f"not {form}: {error}", mend) from None


def _parse_json(text: str) -> object:
    if text.count("{") + text.count("[") > MAX_JSON_LISTS:
        raise ValueError(f"more than {MAX_JSON_LISTS} lists and objects")
    return json.loads(text, object_pairs_hook=_unique_keys)


def _unique_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    table: dict[str, object] = {}
    for key, value in pairs:
        if key in table:
            raise ValueError(f"key {key!r} is given twice in one object")
        table[key] = value
    return table


def check(data: object, model: type[M], source: str | Path) -> M:
    """Check plain data, as TOML gives it, against a settings model or a message; types are not
    coerced.

    Raises:
        InputError: naming the offending key that helps most and what it should be; its `others` are
            the further ones, at most `MAX_FAULTS` in all.
    """
    try:
        text = json.dumps(data, default=str)
    except RecursionError:
        raise InputError(source, "nested too deeply", "mend the file") from None
    except ValueError as error:
        raise InputError(source, f"{error}".partition(";")[0], "mend the file") from None
    if _NUL.search(text):
        raise InputError(source, "a NUL character in a text", "remove it")
    try:
        # JSON's strict rules are TOML's types: "60" is no number, yet a text may be a path.
        return model.model_validate_json(text, strict=True)
    except ValidationError as error:
        raise _as_input_error(error, model, source, data) from None


def load(path: Path, model: type[S]) -> S:
    """Read and check a settings file.

    Raises:
        InputError: see `read_toml` and `check`.
    """
    return check(read_toml(path), model, path)


def model_of(annotation: object, base: type[M]) -> type[M] | None:
    """The model derived from ``base`` that an annotation is, or allows beside None."""
    for option in (annotation, *get_args(annotation)):
        if isinstance(option, type) and issubclass(option, base):
            return option
    return None


def mend_of_unknown(key: str, known: Iterable[str]) -> str:
    """What to do about an unknown key where these are known."""
    near = difflib.get_close_matches(key, list(known), n=1)
    return f"did you mean {near[0]}?" if near else _MEND_UNKNOWN


def _name_of_row(row: object, number: int) -> str:
    names = [row.get(key) for key in _NAMING] if isinstance(row, Mapping) else []
    return next((name for name in names if isinstance(name, str) and name), str(number))


def _as_input_error(
    error: ValidationError, model: type[BaseModel], source: str | Path, data: object
) -> InputError:
    """The fault that helps most, with the others beside it."""
    # A misspelt key is also a missing one; the misspelling is what helps.
    found = sorted(error.errors(include_url=False), key=lambda e: e["type"] not in _UNKNOWN_KEY)
    unknown = {fault["loc"][:-1] for fault in found if fault["type"] in _UNKNOWN_KEY}
    told = [f for f in found if f["type"] != "missing" or f["loc"][:-1] not in unknown]
    first, *others = (_told(fault, model, source, data) for fault in told[:MAX_FAULTS])
    first.others = tuple(others)
    return first


def _told(
    fault: ErrorDetails, model: type[BaseModel], source: str | Path, data: object
) -> InputError:
    key = ".".join(_names(fault["loc"], data)) or None
    message = fault["msg"].removeprefix("Value error, ")
    problem = message[0].lower() + message[1:]
    if fault["type"] in _UNKNOWN_KEY:
        known = _known_keys(model, fault["loc"])
        mend = mend_of_unknown(str(fault["loc"][-1]), known)
        if known and mend == _MEND_UNKNOWN and len(fault["loc"]) == 1:
            mend = f"remove it or use one of: {', '.join(known)}"
        return InputError(source, "unknown key", mend, key=key)
    if fault["type"] == "missing":
        return InputError(source, "missing key", "add it", key=key)
    value = _shown(fault.get("input"))
    said = words_of(fault["type"], fault.get("ctx", {}), value)
    if said is not None:
        return InputError(source, *said, key=key)
    # Of a model's own words the last part may be the mend.
    problem, _, mend = problem.partition("; ")
    shown = f" (got {value})" if value else ""
    return InputError(source, problem + shown, mend or "mend the value", key=key)


def _known_keys(model: type[BaseModel], location: Sequence[int | str]) -> list[str]:
    """The keys that a table may have, by the place of an unknown one, sorted."""
    models = [model]
    for part in location[:-1]:
        fields = [m.model_fields[part] for m in models if part in m.model_fields]
        # A row's number or a name that the user chose leaves the table's type as it is.
        models = [m for field in fields for m in _models_in(field.annotation)] or models
    return sorted({field.alias or name for m in models for name, field in m.model_fields.items()})


def _models_in(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models_in(inner)


def _names(location: Sequence[int | str], data: object) -> Iterator[str]:
    """Parts of a key; a table in a list goes by its id, which is easier to find than its number."""
    for part in location:
        if isinstance(data, Mapping):
            data = data.get(part)
            yield str(part)
            continue
        rows = data if isinstance(data, list | tuple) else ()
        if isinstance(part, int) and part < len(rows):
            yield _name_of_row(rows[part], part)
            data = rows[part]
        else:
            yield str(part)
            data = None


def _shown(value: object) -> str:
    """A faulty value as it may stand in a log: addresses may hold passwords."""
    if isinstance(value, dict | list) or "://" in str(value):
        return ""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."

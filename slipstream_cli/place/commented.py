"""Settings as TOML with the models' own descriptions as comments, beside the keys left at their
defaults.
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any, Final

import tomli_w
from pydantic import BaseModel

from slipstream_cli.settings_doc import Key, Section, sections

_WIDTH: Final = 98
_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")


def commented(model: type[BaseModel], values: Mapping[str, Any], head: str) -> str:
    """A settings file.

    Args:
        model: of the file.
        values: those that are set: texts, numbers, lists, and mappings as tables; lists of mappings
            as arrays of tables.
        head: what the file is, for its first lines.

    Returns:
        TOML. Tables that have no value are named at the end.
    """
    lines = [*_comment(head), ""]
    absent = []
    for section in sections(model):
        path = section.path.strip("[]")
        own = _below(values, path)
        if _is_rows(own):
            lines += _rows(path, section, own)
        elif isinstance(own, Mapping):
            lines += [f"[{path}]"] if path else []
            lines += _table(section, own)
        elif section.keys:
            absent.append(f"[{path}]")
    if absent:
        lines += _comment(f"Further tables, with their keys in the docs: {' '.join(absent)}")
    return "\n".join(lines).rstrip() + "\n"


def _below(values: Mapping[str, Any], path: str) -> Any:
    found: Any = values
    for part in path.split(".") if path else ():
        found = found.get(part) if isinstance(found, Mapping) else None
    return found


def _rows(name: str, section: Section, rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """An array of tables; its first one has the comments."""
    for number, row in enumerate(rows):
        yield f"[[{name}]]"
        if number == 0:
            yield from _table(section, row)
        else:
            yield from (f"{key} = {toml(value)}" for key, value in row.items())
            yield ""


def _table(section: Section, values: Mapping[str, Any]) -> Iterator[str]:
    known = [key.path.rpartition(".")[2] for key in section.keys]
    for key, name in zip(section.keys, known, strict=True):
        value = values.get(name)
        if _is_rows(value) or (value is None and key.type == "list of table"):
            continue
        yield from _comment(_said(key))
        if value is None:
            # "–" stands for a key that has no default value.
            default = key.default.strip("`")
            yield f"#{name} =" if default in ("–", "required") else f"#{name} = {default}"
        else:
            yield f"{name} = {toml(value)}"
    if section.path:
        # A table inside a row stands on one line.
        extra = {name: v for name, v in values.items() if name not in known}
        yield from (f"{name} = {toml(v)}" for name, v in extra.items())
    yield ""


def _is_rows(value: object) -> bool:
    return isinstance(value, Sequence) and bool(value) and isinstance(value[0], Mapping)


def _said(key: Key) -> str:
    text = key.description.replace("`", "")
    bounds = [b for b in key.bounds.replace("`", "").split(", ") if b[0] in "≥≤<>^"]
    return f"{text} ({', '.join(bounds)})".strip() if bounds else text


def _comment(text: str) -> list[str]:
    return [
        line
        for part in text.splitlines()
        for line in textwrap.wrap(part, _WIDTH, initial_indent="# ", subsequent_indent="# ")
        or ["#"]
    ]


def toml(value: object) -> str:
    """A value on one line of TOML."""
    if isinstance(value, Mapping):
        pairs = (
            f"{key if _BARE.fullmatch(key) else json.dumps(key)} = {toml(inner)}"
            for key, inner in value.items()
        )
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, PurePath):
        value = str(value)
    return tomli_w.dumps({"v": value}).removeprefix("v = ").rstrip("\n")

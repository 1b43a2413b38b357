"""Settings as TOML with the models' own descriptions as comments, beside the keys left at their
defaults.
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any, Final

import tomli_w

from slipstream_cli.settings_doc import Key, Section

_WIDTH: Final = 98
_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")


def commented(
    tables: Iterable[Section],
    values: Mapping[str, Any],
    head: str,
    names: Mapping[str, str] | None = None,
) -> str:
    """A settings file.

    Args:
        tables: that it may have, see `sections`.
        values: those that are set: texts, numbers, lists, and mappings as tables; lists of mappings
            as arrays of tables.
        names: by table, what stands for NAME in those of its instances.

    Returns:
        TOML. Tables that have no value are named at the end.
    """
    lines = [*_comment(head), ""]
    absent = []
    for section in tables:
        parts = _parts(section.path, names or {})
        path = ".".join(p if _BARE.fullmatch(p) else json.dumps(p) for p in parts)
        own = _below(values, parts)
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


def _parts(path: str, names: Mapping[str, str]) -> Sequence[str]:
    parts = path.strip("[]").split(".") if path else []
    return [names.get(parts[0], part) if part == "NAME" else part for part in parts]


def _below(values: Mapping[str, Any], parts: Sequence[str]) -> Any:
    found: Any = values
    for part in parts:
        found = found.get(part) if isinstance(found, Mapping) else None
    return found


def _rows(name: str, section: Section, rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """An array of tables; its first one has the comments."""
    for number, row in enumerate(rows):
        yield f"[[{name}]]"
        if number == 0:
            lines = [*_table(section, row)][:-1]
            known = {key.path.rpartition(".")[2] for key in section.keys}
            # A table inside a row stands on one line.
            extra = {key: value for key, value in row.items() if key not in known}
            yield from (*lines, *(f"{key} = {toml(value)}" for key, value in extra.items()), "")
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
        for line in textwrap.wrap(
            part,
            _WIDTH,
            initial_indent="# ",
            subsequent_indent="# ",
            break_on_hyphens=False,
        )
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

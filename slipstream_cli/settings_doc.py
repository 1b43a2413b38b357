"""The reference of all settings, ``docs/settings.md``, from the daemons' settings models.

Run as ``python -m slipstream_cli.settings_doc > docs/settings.md``. A test holds the committed page
to it, and each field to having a description.
"""

from __future__ import annotations

import sys
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Any, Final, get_args

from pydantic import BaseModel

from dashboard.settings import DashboardSettings
from dispatcher_daemon.settings import (
    ClusterSettings,
    DispatcherSettings,
    SchedulerSettings,
    WorkerSettings,
)
from edge_daemon.settings import EdgeSettings
from slipstream.config import ServiceSettings, Settings, model_of
from slipstream.site import NAMED, SHARED, SiteRsu, SiteSettings, own_keys
from slipstream_cli.tables import markdown_table
from vehicle_agent.settings import AgentSettings

DAEMONS: Final[Mapping[str, type[Settings]]] = {
    "edge": EdgeSettings,
    "dispatcher": DispatcherSettings,
    "agent": AgentSettings,
    "dashboard": DashboardSettings,
    "scheduler": SchedulerSettings,
    "worker": WorkerSettings,
}
"""The settings of each daemon, by its sub-command."""

_HEAD: Final = """\
# Settings

Generated from the settings models; do not edit. `make settings-doc` writes this page and a test
holds it to the models.

All daemons read one TOML file: `slipstream COMMAND --config site.toml` with edge, dispatcher,
agent, dashboard, scheduler or worker. What they share stands at its top, once; what is one daemon's
own stands in its section. A roadside unit's table `[rsus.NAME]` may have any key of `[edge]` too,
which then goes before. A machine may have a file with only its own part. Of several RSUs or agents
`--rsu NAME` or `--name NAME` says which. `slipstream check site.toml` validates the file and what
it names. Unknown keys are refused by name.
"required" stands for a key that has to be given, "–" for no default value or no bound.
"""

_OF_RSU: Final = frozenset(("camera", "source"))
"""What no two RSUs have in common."""

_TYPES: Final = {
    "integer": "integer",
    "number": "number",
    "boolean": "true or false",
    "string": "text",
}

_BOUNDS: Final = {
    "minimum": "≥ {}",
    "exclusiveMinimum": "> {}",
    "maximum": "≤ {}",
    "exclusiveMaximum": "< {}",
    "minLength": "length ≥ {}",
    "maxLength": "length ≤ {}",
    "minItems": "entries ≥ {}",
    "maxItems": "entries ≤ {}",
    "pattern": "`{}`",
}


@dataclass(frozen=True)
class Key:
    """One key of a settings file, as the page shows it.

    Attributes:
        path: dotted, from the top of the file.
    """

    path: str
    type: str
    default: str
    bounds: str
    description: str


@dataclass(frozen=True)
class Section:
    """One table of a settings file; the top of the file has the path ""."""

    path: str
    summary: str
    keys: tuple[Key, ...]


def sections(
    model: type[BaseModel],
    path: str = "",
    values: object = None,
    only: Container[str] | None = None,
) -> Iterator[Section]:
    """A model's own keys, then its nested models' sections, in the order of the fields.

    Args:
        values: an instance whose values are the defaults; None: the fields' own.
        only: of the model's own fields; None: all.
    """
    properties = model.model_json_schema()["properties"]
    keys: list[Key] = []
    nested: list[Section] = []
    for name, field in model.model_fields.items():
        if (only is not None and name not in only) or name in getattr(model, "constants", ()):
            continue
        key = field.alias or name
        inner = f"{path}.{key}" if path else key
        default = field.get_default(call_default_factory=True) if values is None else None
        default = default if values is None else getattr(values, name)
        below = model_of(field.annotation, BaseModel)
        if below is not None:
            instance = default if isinstance(default, below) else None
            nested.extend(sections(below, inner, instance))
            continue
        rows = next(iter(get_args(field.annotation)), None)
        if isinstance(rows, type) and issubclass(rows, BaseModel):
            nested.extend(sections(rows, f"[{inner}]"))
        schema = properties[key]
        keys.append(
            Key(
                path=inner,
                type=_type(schema),
                default="required" if field.is_required() else _value(default),
                bounds=", ".join(_bounds(schema)) or "–",
                description=field.description or "",
            )
        )
    yield Section(path, (model.__doc__ or "").strip().split("\n\n")[0], tuple(keys))
    yield from nested


def site_sections() -> Iterator[Section]:
    """All tables of a ``site.toml``: what is shared, then each daemon's."""
    yield from sections(SiteSettings, only=SHARED - {"rsus", "cluster"})
    rsu, *source = sections(EdgeSettings, "rsus.NAME", only=_OF_RSU)
    (head,) = sections(SiteRsu, "rsus.NAME")
    yield replace(head, keys=(*head.keys, *rsu.keys))
    yield from source
    for daemon, model in DAEMONS.items():
        table = f"{NAMED[daemon][0]}.NAME" if daemon == "agent" else daemon
        top, *below = sections(model, table, only=own_keys(daemon, model) - _OF_RSU)
        (port,) = next(sections(ServiceSettings, table, only={"metrics_port"})).keys
        yield replace(top, keys=(*top.keys, port))
        yield from below
    yield from sections(ClusterSettings, "cluster")


def page() -> str:
    """The whole page as Markdown."""
    parts = [_HEAD]
    for section in site_sections():
        # A heading of the first level for what is shared and for each daemon.
        level = "###" if "." in section.path.replace(".NAME", "") else "##"
        title = f"{level} `[{section.path}]`" if section.path else "## At the top"
        summary = " ".join(section.summary.split()).replace("``", "`")
        parts.append(f"{title}\n\n{summary}\n")
        if section.keys:
            parts.append(_table(section) + "\n")
    return "\n".join(parts)


def _table(section: Section) -> str:
    columns = ["key", "type", "default", "bounds", "meaning"]
    rows = [[f"`{k.path}`", k.type, k.default, k.bounds, k.description] for k in section.keys]
    cells = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    return markdown_table(columns, cells, left=range(len(columns)))


def _options(schema: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """What a JSON schema allows beside null."""
    return [option for option in schema.get("anyOf", [schema]) if option.get("type") != "null"]


def _type(schema: Mapping[str, Any]) -> str:
    names = []
    for option in _options(schema):
        if "$ref" in option:
            names.append("table")
        elif "const" in option or "enum" in option:
            choices = option.get("enum", [option.get("const")])
            names.append(", ".join(f"`{choice}`" for choice in choices))
        elif option.get("type") == "array":
            items = option.get("items") or (option.get("prefixItems") or [{}])[0]
            names.append(f"list of {_type(items)}")
        elif option.get("type") == "object":
            names.append(f"table of {_type(option['additionalProperties'])}")
        elif option.get("format") == "path":
            names.append("path")
        else:
            names.append(_TYPES[option["type"]])
    return " or ".join(names)


def _bounds(schema: Mapping[str, Any]) -> Iterator[str]:
    for option in _options(schema):
        for key, text in _BOUNDS.items():
            if key in option:
                value = option[key]
                yield text.format(f"{value:g}" if isinstance(value, float) else value)


def _value(value: object) -> str:
    """A default as TOML writes it."""
    if value is None:
        return "–"
    if isinstance(value, tuple | list):
        return "`[" + ", ".join(_value(entry).strip("`") for entry in value) + "]`"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str | PurePath):
        return f'`"{value}"`'
    return f"`{value}`"


if __name__ == "__main__":
    sys.stdout.write(page())

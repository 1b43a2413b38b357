"""``site.toml``: one file for all daemons. What they share stands at its top, once; what is one
daemon's own stands in its section.

A machine may have a file with its own part only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import ConfigDict, Field

from slipstream.config import (
    DEMO_NETWORK,
    Settings,
    SiteBus,
    SiteService,
    check,
    mend_of_unknown,
    model_of,
    read_toml,
)
from slipstream.errors import InputError, refuse
from slipstream.freshness import STALE_AFTER_S
from slipstream.messages import Identifier
from slipstream.prices import PriceSettings

BOX_NAME: Final = "^[A-Za-z0-9._-]{1,64}$"

S = TypeVar("S", bound=Settings)
Table = Mapping[str, Any]

DEMO_FLEET: Final = "demo"
"""The fleet that comes along."""


class SiteRsu(Settings):
    """A roadside unit (``[rsus.NAME]``), with what of ``[edge]`` is its own."""

    model_config = ConfigDict(extra="allow")

    segments: tuple[Identifier, ...] | None = Field(
        default=None,
        min_length=1,
        description="The segments that it watches. States of others are refused, by the dispatcher "
        "and by the page, which need them of each RSU of their file.",
    )
    box: str | None = Field(
        default=None,
        pattern=BOX_NAME,
        description="The box that it runs on, by the name of its certificate, which is its user "
        "on the bus too; none: this machine.",
    )


class SiteSettings(Settings):
    """What all daemons share, at the top of ``site.toml``."""

    network: str = Field(
        default=DEMO_NETWORK, min_length=1, description="The road network: a SUMO net, or 'demo'."
    )
    fleet: str = Field(default=DEMO_FLEET, min_length=1, description="A fleet file, or 'demo'.")
    database_url: str = Field(
        default="sqlite:///slipstream.db",
        min_length=1,
        description="SQLAlchemy URL of the database: SQLite or PostgreSQL. The dispatcher writes "
        "it, the page reads it.",
    )
    stale_after_s: float = Field(
        default=STALE_AFTER_S,
        gt=0,
        allow_inf_nan=False,
        description="Age from which what an RSU says counts for nothing, s.",
    )
    rsus: dict[Identifier, SiteRsu] = Field(
        default={},
        description="Roadside units by name. Without any, each RSU's states are admitted.",
    )
    prices: PriceSettings = Field(
        default=PriceSettings(), description="Of energy and of time, for the objective energy."
    )
    bus: SiteBus = Field(default=SiteBus(), description="Connection to zenoh.")
    service: SiteService = Field(default=SiteService(), description="Logs and traces.")
    cluster: dict[str, Any] = Field(default={}, description="Machines that solve.")
    edge: dict[str, Any] = Field(default={}, description="What all RSUs of the file have.")
    dispatcher: dict[str, Any] = Field(default={}, description="The dispatcher.")
    dashboard: dict[str, Any] = Field(default={}, description="The page.")
    agents: dict[Identifier, dict[str, Any]] = Field(
        default={},
        description="Processes of vehicles' agents, by name; with a `box`, as in `rsus.NAME`, "
        "those of a vehicle's own.",
    )
    scheduler: dict[str, Any] = Field(default={}, description="The cluster's scheduler.")
    worker: dict[str, Any] = Field(default={}, description="A worker of the cluster.")


NAMED: Final[Mapping[str, tuple[str, str]]] = {
    "edge": ("rsus", "--rsu"),
    "agent": ("agents", "--name"),
}
"""By sub-command, the table of its instances, and the option that names one."""
SHARED: Final = frozenset(
    ("network", "fleet", "database_url", "stale_after_s", "rsus", "prices", "bus", "service")
) | {"cluster"}
_DERIVED: Final = frozenset(("rsu", "depots", "price_per_kwh", "currency"))
"""Keys of daemons' models that other keys of the file give."""
_FROM: Final = {"price_per_kwh": "prices.energy_kwh", "currency": "prices.currency"}


def read_site(path: Path) -> dict[str, Any]:
    """The tables of a file, whose top is sound.

    Raises:
        InputError: it cannot be read, or what is shared is not valid.
    """
    tables = read_toml(path)
    check(tables, SiteSettings, path)
    return tables


def load_site(path: Path, command: str, model: type[S], name: str | None = None) -> S:
    """The settings of one daemon.

    Args:
        path: the file.
        command: the daemon's sub-command.
        model: of its settings.
        name: of the roadside unit or the agents; None: the only one.

    Raises:
        InputError: as `read_site` and `settings_of`.
    """
    return settings_of(read_site(path), path, command, model, name)


def own_keys(command: str, model: type[Settings]) -> frozenset[str]:
    """The keys of a daemon's section."""
    return (frozenset(model.model_fields) - SHARED - _DERIVED - model.constants) | {"metrics_port"}


def names_of(tables: Table, command: str) -> tuple[str, ...]:
    """The instances of a daemon that a file has; those with a box, and RSUs without camera and
    source, are others'.
    """
    table, _ = NAMED[command]
    return tuple(
        name
        for name, own in tables.get(table, {}).items()
        if "box" not in own and (command != "edge" or "camera" in own or "source" in own)
    )


def settings_of(
    tables: Table, path: Path, command: str, model: type[S], name: str | None = None
) -> S:
    """Compose the settings of one daemon from the shared part and its section.

    Raises:
        InputError: something of it is not valid, or no instance has this name.
    """
    if command in NAMED:
        name = _name(tables, path, command, name)
    layers = _layers(tables, command, name)
    allowed = own_keys(command, model)
    faults = list(_unknown(layers, allowed, path))
    faults += (f for prefix, layer in layers for f in _constants(layer, model, path, prefix))
    given: dict[str, Any] = {}
    for _, layer in layers:
        given = _merged(given, {key: layer[key] for key in allowed & layer.keys()})
    shared = _shared(tables, path, command, name)
    port = {"metrics_port": given.pop("metrics_port")} if "metrics_port" in given else {}
    shared["service"] = {**shared.get("service", {}), **port}
    given |= {key: value for key, value in shared.items() if key in model.model_fields}
    try:
        settings = check(given, model, path)
    except InputError as error:
        faults += (_placed(fault, layers, tables) for fault in (error, *error.others))
    refuse(faults)
    return settings


def _name(tables: Table, path: Path, command: str, name: str | None) -> str:
    table, option = NAMED[command]
    known = names_of(tables, command) or tuple(tables.get(table, {}))
    if name is not None and name in known:
        return name
    if not known:
        raise InputError(path, "missing table", f"add [{table}.NAME]", key=table)
    some = ", ".join(known[:20])
    if name is not None:
        raise InputError(path, "no such table", f"give one of: {some}", key=f"{table}.{name}")
    if len(known) > 1:
        raise InputError(option, f"{path} has {some}", "name one of them")
    return known[0]


def _layers(tables: Table, command: str, name: str | None) -> Sequence[tuple[str, Table]]:
    """A daemon's own tables with their names in the file; of two that give a key, the last."""
    if name is None:
        return ((command, tables.get(command, {})),)
    table, _ = NAMED[command]
    others = ("segments", "box")
    own = (f"{table}.{name}", {k: v for k, v in tables[table][name].items() if k not in others})
    return (("edge", tables.get("edge", {})), own) if command == "edge" else (own,)


def _shared(tables: Table, path: Path, command: str, name: str | None) -> dict[str, Any]:
    """What the top of the file says to a daemon, by the keys of its model."""
    shared = {key: tables[key] for key in SHARED if key in tables}
    who = command if name is None else f"{command}-{name}"
    bus = shared.get("bus", {})
    if "password_file" in bus:
        shared["bus"] = {**bus, "user": who}
    if command == "edge":
        shared["rsu"] = name
    elif shared.get("rsus") and command in ("dispatcher", "dashboard"):
        shared["rsus"] = {rsu: _segments(rsu, own, path) for rsu, own in shared["rsus"].items()}
    else:
        shared.pop("rsus", None)
    prices = shared.get("prices", {})
    if command == "dashboard":
        for key, place in _FROM.items():
            if (given := place.partition(".")[2]) in prices:
                shared[key] = prices[given]
        if shared.get("fleet") == DEMO_FLEET:
            del shared["fleet"]
    return shared


def _segments(rsu: str, own: Table, path: Path) -> object:
    if "segments" not in own:
        raise InputError(path, "missing key", "add it", key=f"rsus.{rsu}.segments")
    return own["segments"]


def _unknown(
    layers: Sequence[tuple[str, Table]], allowed: frozenset[str], path: Path
) -> Iterator[InputError]:
    for prefix, table in layers:
        for key in table.keys() - allowed:
            problem, mend = "unknown key", mend_of_unknown(key, allowed)
            if key in SHARED:
                problem, mend = "stands once, at the top of the file", "move it there"
            yield InputError(path, problem, mend, key=f"{prefix}.{key}")


def _constants(
    table: Table, model: type[Settings], path: Path, prefix: str
) -> Iterator[InputError]:
    """Keys of inner tables that no file sets."""
    for key, inner in table.items():
        field = model.model_fields.get(key)
        below = None if field is None else model_of(field.annotation, Settings)
        if below is None or not isinstance(inner, Mapping):
            continue
        for name in inner.keys() & below.constants:
            mend = "remove it, or set effort" if prefix == "dispatcher" else "remove it"
            yield InputError(path, "unknown key", mend, key=f"{prefix}.{key}.{name}")
        yield from _constants(inner, below, path, f"{prefix}.{key}")


def _merged(base: Table, over: Table) -> dict[str, Any]:
    both = {
        key: _merged(base[key], value)
        for key, value in over.items()
        if isinstance(value, Mapping) and isinstance(base.get(key), Mapping)
    }
    return {**base, **over, **both}


def _placed(fault: InputError, layers: Sequence[tuple[str, Table]], tables: Table) -> InputError:
    """A fault of a daemon's settings with the key that the file has."""
    key = _place(fault.key, layers, tables)
    return InputError(fault.source, fault.problem, fault.mend, key=key)


def _place(key: str | None, layers: Sequence[tuple[str, Table]], tables: Table) -> str:
    own = layers[-1][0]
    if key is None:
        return own
    head, *rest = key.split(".")
    if key == "service.metrics_port":
        head, rest = "metrics_port", []
    if head in _FROM:
        return _FROM[head]
    if head in tables and head in SHARED:
        return key
    for prefix, table in reversed(layers):
        if _has(table, (head, *rest)):
            return ".".join((prefix, head, *rest))
    return ".".join((own, head, *rest))


def _has(table: object, parts: Sequence[str]) -> bool:
    for part in parts:
        if not isinstance(table, Mapping):
            return True
        if part not in table:
            return False
        table = table[part]
    return True

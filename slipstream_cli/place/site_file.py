"""The one generator of a ``site.toml`` with all daemons of one machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import tomli_w

from slipstream.config import check
from slipstream.site import NAMED, SiteSettings, names_of, settings_of

Table = Mapping[str, Any]
_COMMANDS: Final = ("edge", "dispatcher", "agent", "dashboard", "scheduler", "worker")


@dataclass(frozen=True)
class SiteSpec:
    """What is one site's own; else the defaults hold.

    Attributes:
        network: SUMO net, or "demo".
        fleet: its file, or "demo".
        database: SQLite file.
        endpoint: of the router.
        port: of the page; the 3D view has the next one.
        rsus: by name: `segments`, `camera`, `source`, and what of `edge` is its own.
        agents: by name: `vehicles`, `state`.
        edge: what all RSUs have.
        dispatcher: its section.
        metrics_ports: by daemon's table; none: no metrics are served.
    """

    network: str
    fleet: str
    database: Path
    endpoint: str
    port: int
    rsus: Mapping[str, Table]
    agents: Mapping[str, Table] = field(default_factory=dict)
    edge: Table = field(default_factory=dict)
    dispatcher: Table = field(default_factory=dict)
    metrics_ports: Mapping[str, int] = field(default_factory=dict)


def scene_port_of(port: int) -> int:
    """The 3D view's port beside that of the operator's page."""
    return port + 1


def tables_of(place: SiteSpec) -> dict[str, Any]:
    """The tables of its file, which all daemons take.

    Raises:
        InputError: something of it is not valid.
    """
    ports = {name: {"metrics_port": port} for name, port in place.metrics_ports.items()}
    tables: dict[str, Any] = {
        "network": place.network,
        "fleet": place.fleet,
        "database_url": f"sqlite:///{place.database.absolute()}",
        "bus": {"connect": [place.endpoint]},
        "rsus": place.rsus,
        "edge": {**place.edge, **ports.get("edge", {})},
        "dispatcher": {**place.dispatcher, **ports.get("dispatcher", {})},
        "agents": {n: {**own, **ports.get("agents", {})} for n, own in place.agents.items()},
        "dashboard": {
            "port": place.port,
            "scene_port": scene_port_of(place.port),
            **ports.get("dashboard", {}),
        },
    }
    tables = _plain(tables)
    check(tables, SiteSettings, "site.toml")
    for command, name in daemons_of(tables):
        settings_of(tables, Path("site.toml"), command, _model(command), name)
    return tables


def daemons_of(tables: Table) -> Iterator[tuple[str, str | None]]:
    """Sub-command and name of each daemon that a file has a table of."""
    for command in _COMMANDS:
        if command in NAMED:
            yield from ((command, name) for name in names_of(tables, command))
        elif command in tables:
            yield command, None


def write_site(path: Path, place: SiteSpec) -> dict[str, tuple[str, ...]]:
    """Write the file.

    Returns:
        Sub-command and options of each daemon, by its name.
    """
    tables = tables_of(place)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomli_w.dumps(tables))
    return {name or command: words_of(path, command, name) for command, name in daemons_of(tables)}


def words_of(path: Path, command: str, name: str | None) -> tuple[str, ...]:
    """Sub-command and options of a daemon."""
    naming = () if name is None else (NAMED[command][1], name)
    return (command, "--config", str(path), *naming)


def _model(command: str) -> Any:
    from slipstream_cli.settings_doc import DAEMONS

    return DAEMONS[command]


def _plain(value: Any) -> Any:
    """As TOML has it: paths are texts."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return str(value) if isinstance(value, Path) else value

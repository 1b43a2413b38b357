"""The example settings."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from dispatcher_daemon.fleet.file import FleetFile
from slipstream.sumo_net import load_network
from slipstream_cli.main import main

from .conftest import DEPLOY


def test_the_examples_are_valid(etc: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`slipstream check` accepts the settings of all daemons as they are shipped."""
    names = ("edge-rsu-1", "dispatcher", "dashboard", "agent-depot-1", "scheduler", "worker")
    files = [etc / f"{name}.toml" for name in names]
    assert main(["check", *map(str, files)]) == 0
    said = capsys.readouterr().out
    kinds = ["edge", "dispatcher", "dashboard", "agent", "scheduler", "worker"]
    assert [line.split()[-2] for line in said.splitlines()] == kinds


def test_the_examples_fit_together() -> None:
    """One router, one database, one network, no metrics port twice, the page on loopback."""
    edge, dispatcher, dashboard, agent = daemons = tuple(
        tomllib.loads((DEPLOY / "config" / f"{name}.toml").read_text())
        for name in ("edge-rsu-1", "dispatcher", "dashboard", "agent-depot-1")
    )
    assert len({tuple(settings["bus"]["connect"]) for settings in daemons}) == 1
    users = [settings["bus"]["user"] for settings in daemons]
    assert users == [f"edge-{edge['rsu']}", "dispatcher", "dashboard", "agent-depot-1"]
    roads = load_network(dispatcher["network"])
    fleet = FleetFile(dispatcher["fleet"], roads).current()
    assert fleet is not None
    assert [vehicle["id"] for vehicle in agent["vehicles"]] == [one.id for one in fleet.vehicles]
    assert agent["stale_after_s"] == dispatcher["stale_after_s"]
    # The folder that the unit makes for it.
    assert agent["state"] == "/var/lib/slipstream-agent/depot-1"
    unit = (DEPLOY / "systemd" / "slipstream-agent@.service").read_text()
    assert "\nStateDirectory=slipstream-agent/%i\n" in unit
    assert dispatcher["database_url"] == dashboard["database_url"]
    assert dispatcher["network"] == dashboard["network"]
    ports = [settings["service"]["metrics_port"] for settings in daemons]
    assert len({*ports, dashboard["port"]}) == 5
    assert dashboard["host"] == "127.0.0.1"

"""The example settings."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from dispatcher_daemon.fleet.file import FleetFile
from slipstream.roads.sumo_net import load_network
from slipstream_cli.main import main

from .conftest import DEPLOY

PARTS = ("edge", "server", "agent", "worker")


@pytest.mark.slow
def test_the_examples_are_valid(etc: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`slipstream check` accepts what each machine gets, and all of it on one."""
    files = [etc / "site.toml", *(etc / f"site-{part}.toml" for part in PARTS)]
    assert main(["check", *map(str, files)]) == 0
    assert [line.split()[-1] for line in capsys.readouterr().out.splitlines()] == ["site"] * 5


def test_the_parts_are_those_of_the_whole() -> None:
    """A machine's example says nothing that the one for a single machine does not."""
    whole = tomllib.loads((DEPLOY / "config" / "site.toml").read_text())
    for part in ("edge", "server", "agent"):
        own = tomllib.loads((DEPLOY / "config" / f"site-{part}.toml").read_text())
        for name, table in own.items():
            assert table == whole[name] or (name == "rsus" and part in ("edge", "server")), name
    vehicles = [vehicle["id"] for vehicle in whole["agents"]["depot-1"]["vehicles"]]
    fleet = FleetFile(whole["fleet"], load_network(whole["network"])).current()
    assert fleet is not None
    assert vehicles == [one.id for one in fleet.vehicles]
    # The folder that the unit makes for it.
    assert whole["agents"]["depot-1"]["state"] == "/var/lib/slipstream-agent/depot-1"
    unit = (DEPLOY / "systemd" / "slipstream-agent@.service").read_text()
    assert "\nStateDirectory=slipstream-agent/%i\n" in unit
    assert whole["dashboard"]["host"] == "127.0.0.1"

"""The example settings."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from slipstream_cli.main import main

from .conftest import DEPLOY


def test_the_examples_are_valid(etc: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`slipstream check` accepts the settings of all three daemons as they are shipped."""
    files = [etc / name for name in ("edge-rsu-1.toml", "dispatcher.toml", "dashboard.toml")]
    assert main(["check", *map(str, files)]) == 0
    said = capsys.readouterr().out
    assert [line.split()[-2] for line in said.splitlines()] == ["edge", "dispatcher", "dashboard"]


def test_the_examples_fit_together() -> None:
    """One router, one database, one network, no metrics port twice, the page on loopback."""
    edge, dispatcher, dashboard = (
        tomllib.loads((DEPLOY / "config" / f"{name}.toml").read_text())
        for name in ("edge-rsu-1", "dispatcher", "dashboard")
    )
    assert edge["bus"]["connect"] == dispatcher["bus"]["connect"] == dashboard["bus"]["connect"]
    users = [settings["bus"]["user"] for settings in (edge, dispatcher, dashboard)]
    assert users == [f"edge-{edge['rsu']}", "dispatcher", "dashboard"]
    assert dispatcher["database_url"] == dashboard["database_url"]
    assert dispatcher["network"] == dashboard["network"]
    ports = [s["service"]["metrics_port"] for s in (edge, dispatcher, dashboard)]
    assert len({*ports, dashboard["port"]}) == 4
    assert dashboard["host"] == "127.0.0.1"

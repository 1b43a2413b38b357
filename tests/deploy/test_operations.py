"""The operator's page says what each figure means."""

from __future__ import annotations

import subprocess
import sys

import pytest

from slipstream.messages import DispatcherHealth, RsuHealth

from .conftest import ROOT

PAGE = (ROOT / "docs" / "operations.md").read_text()


@pytest.mark.parametrize("message", [RsuHealth, DispatcherHealth])
def test_every_health_field_is_explained(message: type[RsuHealth | DispatcherHealth]) -> None:
    """No field of a health message is left out."""
    assert [name for name in message.model_fields if f"`{name}`" not in PAGE] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "daemon", ["edge_daemon", "dispatcher_daemon", "dashboard", "vehicle_agent"]
)
def test_every_metric_is_explained(daemon: str) -> None:
    """Each metric that a daemon registers is on the page, by the name Prometheus sees."""
    code = (
        f"import {daemon}.metrics, prometheus_client as p\n"
        "for m in p.REGISTRY.collect():\n"
        "    print(m.name + ('_total' if m.type == 'counter' else ''))"
    )
    names = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout.split()
    ours = [name for name in names if name.startswith("slipstream_")]
    assert ours
    assert [name for name in ours if f"`{name}" not in PAGE] == []


def test_every_unit_and_example_is_named() -> None:
    """What is installed can be found on the page."""
    for unit in (ROOT / "deploy" / "systemd").glob("*.service"):
        assert unit.stem.rstrip("@") in PAGE
    for example in (
        *("router-server.json5", "router-rsu.json5", "router-vehicle.json5", "nginx.conf"),
        *("site-edge.toml", "site-agent.toml", "site-server.toml", "site-worker.toml"),
    ):
        assert example in PAGE

"""Settings of the built-in demo."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from dispatcher_daemon.settings import DispatcherSettings
from slipstream.config import load
from slipstream_lab.commands.live.demo import ROADSIDES, _of_town, write_settings
from slipstream_lab.simulation.live.world_spec import WorldSpec


@pytest.mark.parametrize(
    ("hardware", "shots", "budget_s"),
    [("", 4096, 60.0), ("fake:FakeBoston", 256, 3600.0), ("ibm:least-busy", 4096, 60.0)],
)
def test_a_device_is_configured_where_it_is_asked_for(
    tmp_path: Path, hardware: str, shots: int, budget_s: float
) -> None:
    """Off by default; a fake device gets a trial's settings, a real one the careful defaults."""
    clips = {r.rsu: dict.fromkeys(r.clips, tmp_path) for r in ROADSIDES}
    files = write_settings(
        tmp_path,
        clips,
        bus_endpoint="tcp/127.0.0.1:1",
        database=tmp_path / "x.db",
        dashboard_port=8080,
        interval_s=20.0,
        hardware=hardware,
    )
    command, path = files["dispatcher"]
    device = load(path, DispatcherSettings).hardware
    assert command == "dispatcher"
    assert (device.backend, device.shots, device.budget_s_per_day) == (hardware, shots, budget_s)
    assert ("hardware" in path.read_text()) == bool(hardware)


def test_a_towns_circuit_is_one_that_its_form_has(tmp_path: Path) -> None:
    """One-hot circuits need route options; without them each cycle would say that it failed."""
    town = cast(WorldSpec, SimpleNamespace(fleet=tmp_path / "fleet.json"))
    settings = DispatcherSettings.model_validate(_of_town(town))
    assert "lc-qaoa" in settings.solvers
    assert settings.lc_qaoa.variant.startswith("one-hot")
    assert settings.form == "route"

"""Settings of the built-in demo."""

from __future__ import annotations

from pathlib import Path

import pytest

from dispatcher_daemon.settings import DispatcherSettings
from slipstream.site import load_site
from slipstream_cli.place.site_file import write_site
from slipstream_lab.commands.live.demo import ROADSIDES, _of_town, place_of_demo


@pytest.mark.parametrize(
    ("hardware", "shots", "budget_s"),
    [("", 4096, 60.0), ("fake:FakeBoston", 256, 3600.0), ("ibm:least-busy", 4096, 60.0)],
)
def test_a_device_is_configured_where_it_is_asked_for(
    tmp_path: Path, hardware: str, shots: int, budget_s: float
) -> None:
    """Off by default; a fake device gets a trial's settings, a real one the careful defaults."""
    clips = {r.rsu: dict.fromkeys(r.clips, tmp_path) for r in ROADSIDES}
    place = place_of_demo(
        clips,
        bus_endpoint="tcp/127.0.0.1:1",
        database=tmp_path / "x.db",
        dashboard_port=8080,
        interval_s=20.0,
        hardware=hardware,
    )
    path = tmp_path / "site.toml"
    daemons = write_site(path, place)
    assert daemons["dispatcher"] == ("dispatcher", "--config", str(path))
    device = load_site(path, "dispatcher", DispatcherSettings).hardware
    assert (device.backend, device.shots, device.budget_s_per_day) == (hardware, shots, budget_s)
    assert ("hardware" in path.read_text()) == bool(hardware)


def test_a_towns_circuit_is_one_that_its_form_has() -> None:
    """One-hot circuits need route options; without them each cycle would say that it failed."""
    settings = DispatcherSettings.model_validate(_of_town())
    assert "lc-qaoa" in settings.solvers
    assert settings.lc_qaoa.variant.startswith("one-hot")
    assert settings.form == "route"

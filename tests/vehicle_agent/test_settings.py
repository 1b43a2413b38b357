"""Settings of the agents that cannot be used."""

from __future__ import annotations

from pathlib import Path

import pytest

from slipstream_cli.main import main


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("vehicles = []\n", "agents.a.vehicles"),
        ('vehicles = [{ id = "a" }, { id = "a" }]\n', "twice"),
        ('vehicles = [{ id = "a", type.length_m = -1 }]\n', "agents.a.vehicles.a.type.length_m"),
        (
            'vehicles = [{ id = "a", type.braking.lag_s = -1 }]\n',
            "agents.a.vehicles.a.type.braking.lag_s: -1 is below 0; give 0 or more",
        ),
        (
            'vehicles = [{ id = "a", type.braking.guaranteed_mps2 = { dry = 5, wet = 4 } }]\n',
            "agents.a.vehicles.a.type.braking.guaranteed_mps2.snow: missing key; add it",
        ),
        ('road = "ice"\nvehicles = [{ id = "a" }]\n', "agents.a.road: 'ice' is none of"),
    ],
)
def test_bad_settings_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, named: str
) -> None:
    """Exit status 2, naming the key."""
    config = tmp_path / "agent.toml"
    config.write_text(f"[agents.a]\n{text}")
    assert main(["agent", "--config", str(config)]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert named in line

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

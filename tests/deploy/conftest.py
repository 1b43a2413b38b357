"""Where the files to deploy are, and the example settings installed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "deploy"


@pytest.fixture
def etc(tmp_path: Path) -> Path:
    """A copy of the example settings, installed below a temporary folder."""
    folder = tmp_path / "etc" / "slipstream"
    state = tmp_path / "var" / "lib" / "slipstream"
    shutil.copytree(DEPLOY / "config", folder)
    state.mkdir(parents=True)
    for path in folder.glob("*.toml"):
        text = path.read_text()
        text = text.replace("/etc/slipstream", str(folder)).replace(
            "/var/lib/slipstream", str(state)
        )
        path.write_text(text)
    return folder

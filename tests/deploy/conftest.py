"""Where the files to deploy are, and the tools that judge them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "deploy"


@pytest.fixture
def tool() -> Callable[[str], str]:
    """Path of a program; the test is skipped where it is not installed."""

    def find(name: str) -> str:
        path = shutil.which(name) or shutil.which(name, path="/usr/sbin:/sbin")
        if path is None:
            pytest.skip(f"{name} is not installed")
        return path

    return find


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

"""Clips that several tests read."""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from slipstream_lab.simulation.streetdrive import ClipSettings, render_clip

SETTINGS = ClipSettings(seconds=2.0, fps=15.0, scenario="mixed", seed=7)


@dataclass(frozen=True)
class Clip:
    """A rendered clip, read back."""

    folder: Path
    rows: list[dict[str, Any]]
    camera: dict[str, Any]


def read_clip(folder: Path) -> Clip:
    """Read truth and calibration of a clip's folder."""
    with (folder / "truth.csv").open(newline="") as file:
        rows: list[dict[str, Any]] = [
            {key: value if key == "class" else float(value) for key, value in row.items()}
            for row in csv.DictReader(file)
        ]
    return Clip(folder, rows, tomllib.loads((folder / "camera.toml").read_text()))


@pytest.fixture(scope="session")
def mixed_clip(made_once: Callable[..., Path]) -> Clip:
    """Two seconds with calm incoming and stop-and-go outgoing traffic."""
    return read_clip(made_once("mixed", partial(render_clip, SETTINGS)))


@pytest.fixture(scope="session")
def paper_clip(made_once: Callable[..., Path]) -> Clip:
    """One second under the paper's law of motion."""
    settings = ClipSettings(seconds=1.0, fps=20.0, scenario="paper", seed=3)
    return read_clip(made_once("paper", partial(render_clip, settings)))

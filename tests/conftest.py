"""Fixtures that several packages' tests share."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from slipstream.bus import Bus, Router
from slipstream.config import BusSettings

# Shared machines are slow at times, and a suite has to say the same thing twice.
settings.register_profile(
    "slipstream",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("slipstream")


@pytest.fixture
def router() -> Iterator[Router]:
    """A zenoh router on a free loopback port."""
    with Router() as running:
        yield running


@pytest.fixture
def bus(router: Router) -> Iterator[Bus]:
    """A session connected to the router."""
    with Bus.open(BusSettings(connect=(router.endpoint,))) as session:
        yield session


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with the real clip and the COCO weights, where the machine has it."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no shared data beside the checkout")
    return folder


@pytest.fixture(scope="session")
def street_clips(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of a calm and a stop-and-go clip: 14 s at 15 frames a second, seeds of their own."""
    from simulation.streetdrive.clip import ClipSettings, render_clip

    folders = {}
    for scenario, seed in (("stable", 31), ("turbulent", 32)):
        folder = tmp_path_factory.mktemp(scenario)
        settings = ClipSettings(
            seconds=14, fps=15, scenario=scenario, seed=seed, segment_id=f"{scenario}_road"
        )
        render_clip(settings, folder)
        folders[scenario] = folder
    return folders


CHROMIUM = "/usr/bin/chromium"
_CHROMIUM_ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


@pytest.fixture
def browser() -> Iterator[Any]:
    """A headless Chromium that draws WebGL in software."""
    if shutil.which(CHROMIUM) is None:
        pytest.skip(f"no browser at {CHROMIUM}")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=_CHROMIUM_ARGUMENTS)
        yield running
        running.close()

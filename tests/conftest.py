"""Fixtures that several packages' tests share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from slipstream.bus import Bus, Router
from slipstream.config import BusSettings


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

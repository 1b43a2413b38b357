"""The page of capacities has what is computed from the coefficients."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from slipstream_lab.benchmarks.capacity import LOADS, needs, tables


def test_the_page_has_the_tables() -> None:
    """As the command prints them."""
    page = Path(__file__).parents[3] / "docs" / "capacity.md"
    assert tables() in page.read_text()


def test_needs_grow_with_the_load() -> None:
    """Twice the vehicles of a region take twice the dispatchers, as of cameras the cores."""
    region = LOADS[-1]
    twice = needs(replace(region, rsus=2 * region.rsus, vehicles=2 * region.vehicles))
    assert int(twice["dispatchers"]) == 2 * int(needs(region)["dispatchers"])
    assert twice["segment states a second"] == "80,000"

"""The built-in scenarios and ten minutes of Troy's morning, which several tests read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from slipstream_lab.simulation.scenarios.day import run_day
from slipstream_lab.simulation.scenarios.record import SimulatedDay
from slipstream_lab.simulation.scenarios.scenario import (
    BackgroundTraffic,
    Scenario,
    day_spec,
    load_scenario,
    prepare,
)

BEGIN_S, END_S = 27000.0, 27600.0


@dataclass(frozen=True)
class Morning:
    """A part of a day and what it was made of."""

    scenario: Scenario
    background: BackgroundTraffic
    folder: Path
    day: SimulatedDay


@pytest.fixture(scope="session")
def troy() -> Scenario:
    """Troy as it ships."""
    return load_scenario("troy")


@pytest.fixture(scope="session")
def corridor() -> Scenario:
    """The corridor as it ships."""
    return load_scenario("corridor")


@pytest.fixture(scope="session")
def morning(troy: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Morning:
    """Troy from 7:30 to 7:40."""
    folder = tmp_path_factory.mktemp("morning")
    background = prepare(troy, 1, folder)
    order = day_spec(troy, background, folder, begin_s=BEGIN_S, end_s=END_S)
    order = replace(order, window_every_s=60.0)
    return Morning(troy, background, folder, run_day(order))

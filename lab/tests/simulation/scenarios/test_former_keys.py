"""Scenario files of the version before are still read."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest

from slipstream.config import load
from slipstream_lab.simulation.scenarios.demand import DemandSettings
from slipstream_lab.simulation.scenarios.networks import CorridorSettings

DEMAND = """
shortest_m = 500.0

[zones.all]
base = 1.0

[[flows]]
name = "trips"
trips = 10
origin = "all"
destination = "all"
hours = [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]
reach_m = 3000.0

[types]
car = 1.0

[[breakdowns]]
name = "noon"
segments = ["road"]
begin_s = [43200.0, 43200.0]
lasts_s = [1800.0, 3600.0]
"""

SHAPE = "leaving_m = 300.0\nbetween_m = 700.0\njoining_m = 400.0\n"


def test_former_keys_are_read_with_a_line_each(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Demand and corridor shape with every renamed key: same values, and a deprecation line."""
    caplog.set_level(logging.WARNING, "slipstream.config")
    (tmp_path / "demand.toml").write_text(DEMAND)
    (tmp_path / "shape.toml").write_text(SHAPE)
    demand = load(tmp_path / "demand.toml", DemandSettings)
    assert demand.min_trip_m == 500.0
    assert demand.flows[0].decay_length_m == 3000.0
    assert demand.breakdowns[0].duration_s == (1800.0, 3600.0)
    shape = load(tmp_path / "shape.toml", CorridorSettings)
    assert shape == CorridorSettings(
        deceleration_lane_m=300.0, ramp_spacing_m=700.0, acceleration_lane_m=400.0
    )
    assert len(caplog.messages) == 6
    assert all("is deprecated, the key is now" in line for line in caplog.messages)


def test_a_demands_digest_does_not_change_with_its_keys_names(tmp_path: Path) -> None:
    """Stored arms hold the digest of the demand; it is of the former names."""
    (tmp_path / "demand.toml").write_text(DEMAND)
    stored = json.loads(load(tmp_path / "demand.toml", DemandSettings).digest_text())
    assert stored["shortest_m"] == 500.0
    assert stored["flows"][0]["reach_m"] == 3000.0
    assert stored["breakdowns"][0]["lasts_s"] == [1800.0, 3600.0]

"""Segment states into the real dispatcher, in the short form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.service.costs import message_costs
from benchmarks.service.loaded import Cost
from benchmarks.service.telemetry import Figures, checks, measure, write
from slipstream.inbox import OUTCOMES

GOOD = Figures(
    rsus=2,
    rate=100.0,
    seconds=3.0,
    sent=300,
    accepted=300,
    outcomes=dict.fromkeys(OUTCOMES, 0) | {"taken": 300},
    missed=0,
    cpu_share=0.5,
    p99_s=0.025,
    within=0.999,
    late_s=0.0,
)

COST = Cost("segment state", 700.0, 65e-6, 20e-6, 0)


@pytest.mark.parametrize(
    "changes", [{"accepted": 299}, {"cpu_share": 1.1}, {"within": 0.98, "p99_s": 0.25}]
)
def test_each_aim_can_be_missed(changes: dict[str, float], tmp_path: Path) -> None:
    """A lost state, a second core and a late hundredth each end in status 1."""
    assert all(check.reached for check in checks(GOOD))
    bad = replace(GOOD, **changes)  # type: ignore[arg-type]
    assert [check.reached for check in write(tmp_path, bad, [bad], [COST], {})].count(False) == 1
    assert "MISSED" in (tmp_path / "report.md").read_text()


@pytest.mark.process
@pytest.mark.slow(long=True)
def test_no_state_is_lost_between_publishers_and_the_traffic_table(tmp_path: Path) -> None:
    """1,000 states a second from 10 sessions, past the real router, into the real dispatcher."""
    found = measure(10, 100, 3.0, tmp_path, lambda _: None)
    assert found.sent > 2500
    assert found.lost == 0
    assert found.missed == 0
    assert found.outcomes == dict.fromkeys(OUTCOMES, 0) | {"taken": found.sent}
    assert found.p99_s is not None


@pytest.mark.process
@pytest.mark.slow(long=True)
def test_a_message_has_a_cost_in_each_process(tmp_path: Path) -> None:
    """Two rates each of states and positions; all of them are handled."""
    for cost in message_costs(3.0, tmp_path, lambda _: None):
        assert cost.lost == 0
        assert 100 < cost.bytes < 2000
        assert 1e-6 < cost.dispatcher_s < 5e-3

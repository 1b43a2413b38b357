"""Segment states into the real dispatcher, in the short form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from slipstream.bus.inbox import OUTCOMES
from slipstream_lab.benchmarks.orders.__main__ import InsertionFigures
from slipstream_lab.benchmarks.service.__main__ import main
from slipstream_lab.benchmarks.service.costs import message_costs
from slipstream_lab.benchmarks.service.loaded import Cost
from slipstream_lab.benchmarks.service.parts import cluster_checks, cluster_table, order_checks
from slipstream_lab.benchmarks.service.telemetry import TelemetryFigures, checks, measure, write

GOOD = TelemetryFigures(
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


@pytest.mark.nightly
@pytest.mark.process
def test_no_state_is_lost_between_publishers_and_the_traffic_table(tmp_path: Path) -> None:
    """1,000 states a second from 10 sessions, past the real router, into the real dispatcher."""
    found = measure(10, 100, 3.0, tmp_path, lambda _: None)
    assert found.sent > 2500
    assert found.lost == 0
    assert found.missed == 0
    assert found.outcomes == dict.fromkeys(OUTCOMES, 0) | {"taken": found.sent}
    assert found.p99_s is not None


@pytest.mark.nightly
@pytest.mark.process
def test_a_message_has_a_cost_in_each_process(tmp_path: Path) -> None:
    """Two rates each of states and positions; all of them are handled."""
    for cost in message_costs(3.0, tmp_path, lambda _: None):
        assert cost.lost == 0
        assert 100 < cost.bytes < 2000
        assert 1e-6 < cost.dispatcher_s < 5e-3


def test_orders_are_held_to_their_aims() -> None:
    """One late percentile or one order that is in no plan misses its aim, and no other one."""
    good = InsertionFigures([0.01] * 20, [0.005] * 20, [0.3] * 20, ran=True)
    assert [check.reached for check in order_checks(good)] == [True] * 4
    late = replace(good, during=[0.2] * 20)
    assert [check.reached for check in order_checks(late)] == [False, True, True, True]
    lost = replace(good, placed=[0.3] * 19)
    assert [check.reached for check in order_checks(lost)] == [True, True, True, False]
    assert not order_checks(replace(good, placed=[]))[2].reached


def test_every_number_of_workers_has_to_give_the_same_plan() -> None:
    """Another plan misses the aim; where the deadline ended a cycle nothing is said."""
    run: dict[str, object] = {"wall_s": 3.0, "timed_out": False, "objective_kwh": 5.9, "bytes": 7.0}
    runs = [{**run, "workers": workers, "plan": "a"} for workers in (0, 1, 2)]
    assert [check.reached for check in cluster_checks(runs)] == [True]
    assert "| 2 | 3.0 | 5.9 | a | 7 | no |" in cluster_table(runs)
    other = [*runs[:2], {**runs[2], "plan": "b"}]
    assert [check.reached for check in cluster_checks(other)] == [False]
    ended = [*other[:2], {**other[2], "timed_out": True}]
    assert [check.reached for check in cluster_checks(ended)] == [None]


def test_an_unknown_part_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By the names of those there are, before anything is measured."""
    assert main(["--only", "states,order", "--out", str(tmp_path)]) == 2
    assert "states, orders, cluster" in capsys.readouterr().err

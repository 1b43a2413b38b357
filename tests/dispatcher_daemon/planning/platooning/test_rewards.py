from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Any, Literal

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.platooning.rewards import JudgedPair, judge_pairs, rewards
from dispatcher_daemon.planning.roads.routes import RoutedArc, candidate_arcs
from dispatcher_daemon.planning.roads.travel import least_energy_legs
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot, take_snapshot
from slipstream.messages import SegmentState
from slipstream_lab.commands.solve.report import explained

Traffic = Callable[..., TrafficSnapshot]


def judge(
    demo: RoutingProblem, snapshot: TrafficSnapshot, window_s: float = 3.0
) -> tuple[tuple[RoutedArc, ...], list[JudgedPair]]:
    """Candidate arcs and judged pairs."""
    arcs = candidate_arcs(demo, least_energy_legs(demo, snapshot))
    return arcs, list(judge_pairs(demo, arcs, snapshot, window_s))


def test_reward_is_a_quarter_of_the_drag_energy(demo: RoutingProblem, traffic: Traffic) -> None:
    """A follower's 20 % and a leader's 5 % of ½ρC_dAv²d/η over the segment, in kWh."""
    arcs, judged = judge(demo, traffic(avenue_east=1))
    (pair,) = rewards(judged)
    drag_n = 0.5 * 1.225 * 0.30 * 2.4 * 16.67**2
    length_m = demo.network.segments["avenue_east"].length_m
    assert pair.saving_kwh == pytest.approx(0.25 * drag_n * length_m / (3.6e6 * 0.88))
    assert pair.segment == "avenue_east"
    assert {arcs[pair.first].vehicle, arcs[pair.second].vehicle} == {"van-a", "van-b"}


@pytest.mark.parametrize(
    ("y_e", "window_s", "reason"),
    [
        (0, 3.0, "gate closed (turbulent)"),
        (None, 3.0, "gate closed (uncertain)"),
        (1, 1.9, "entry times 2.0 s apart, more than 1.9 s"),
    ],
)
def test_every_zero_has_its_reason(
    demo: RoutingProblem,
    state: Callable[..., SegmentState],
    y_e: int | None,
    window_s: float,
    reason: str,
) -> None:
    """A closed gate or a missed window earns nothing, and the explanation says which."""
    # Turbulence without spread in acceleration leaves the avenue the cheapest way.
    seen = state("avenue_east", y_e, acceleration_variance_m2ps4=0.0)
    snapshot = take_snapshot(demo.network, [seen], seen.time_ns, stale_after_s=5.0)
    _, judged = judge(demo, snapshot, window_s)
    assert rewards(judged) == ()
    (pair,) = [p for p in judged if p.segment == "avenue_east"]
    assert pair.reason == reason


def test_an_explanation_tells_who_where_when_and_what(
    demo: RoutingProblem, traffic: Traffic
) -> None:
    """Both vehicles with their ways and entries."""
    arcs, judged = judge(demo, traffic(avenue_east=1))
    (pair,) = [p for p in judged if p.reason is None]
    assert explained(pair, arcs) == (
        "avenue_east: van-a (depot→c1, enters at 90.0 s) and van-b (depot→c3, enters at 92.0 s): "
        f"saves {pair.saving_kwh:.5f} kWh"
    )


def test_every_pair_of_two_vehicles_is_judged_once(demo: RoutingProblem, traffic: Traffic) -> None:
    """Whatever order their arcs come in; two arcs of one vehicle are no pair."""
    arcs, judged = judge(demo, traffic(avenue_east=1, avenue_west=1))
    expected = {
        (name, first, second)
        for name in ("avenue_east", "avenue_west")
        for first, second in combinations(range(len(arcs)), 2)
        if name in arcs[first].entries_s()
        and name in arcs[second].entries_s()
        and arcs[first].vehicle != arcs[second].vehicle
    }
    assert len(expected) > 3
    assert sorted((p.segment, p.first, p.second) for p in judged) == sorted(expected)
    for pair in judged:
        assert pair.first_entry_s == arcs[pair.first].entries_s()[pair.segment]
        assert pair.second_entry_s == arcs[pair.second].entries_s()[pair.segment]


def test_window_includes_its_end(demo: RoutingProblem, traffic: Traffic) -> None:
    """Entry times exactly Δt_sync apart still count (paper: ≤)."""
    _, judged = judge(demo, traffic(avenue_east=1), 3.0)
    (pair,) = judged
    apart = abs(pair.first_entry_s - pair.second_entry_s)
    assert len(rewards(judge(demo, traffic(avenue_east=1), apart)[1])) == 1


def test_the_exact_objective_counts_no_reward_that_may_not_come_about(
    demo: RoutingProblem, traffic: Traffic
) -> None:
    """What the paper's form rewards is judged again: an uncertain departure, or leaving a segment
    apart or in another order, earns nothing, and the explanation says which.
    """
    snapshot = traffic(avenue_east=1, avenue_west=1)
    arcs = candidate_arcs(demo, least_energy_legs(demo, snapshot))

    def judged(arcs: tuple[RoutedArc, ...], objective: Literal["energy", "paper"]) -> JudgedPair:
        problem = replace(demo, objective=objective)
        return next(
            p for p in judge_pairs(problem, arcs, snapshot, 3.0) if p.saving_kwh or p.reason
        )

    pair = judged(arcs, "paper")
    assert pair.saving_kwh > 0
    first, second = arcs[pair.first], arcs[pair.second]

    def with_second(**changes: Any) -> tuple[RoutedArc, ...]:
        changed = replace(second, **changes)
        return tuple(changed if arc is second else arc for arc in (first, second))

    assert judged((first, second), "energy").saving_kwh == pair.saving_kwh
    unsure = with_second(exact=False)
    assert judged(unsure, "paper").saving_kwh == pair.saving_kwh
    assert "depends on the stops before it" in (judged(unsure, "energy").reason or "")
    waiting = [0.0] * len(second.leg.path)
    waiting[second.leg.path.index(pair.segment)] = 8.0
    late = with_second(leg=replace(second.leg, drive=second.leg.drive.delayed(waiting)))
    assert judged(late, "paper").saving_kwh == pair.saving_kwh
    assert "due to leave it" in (judged(late, "energy").reason or "")

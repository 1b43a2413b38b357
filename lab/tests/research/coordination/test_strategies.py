"""Strategies: what each does on days so small that one sees it, and rules that all keep."""

from __future__ import annotations

import numpy as np
import pytest

from slipstream_lab.research.coordination.case import CoordinationCase, build_case
from slipstream_lab.research.coordination.local_search import local_search, nobody_worse_off
from slipstream_lab.research.coordination.pairwise import pairwise_leaders
from slipstream_lab.research.coordination.plan import check, evaluate, undelayed
from slipstream_lab.research.coordination.schedule import Schedule, Worth
from slipstream_lab.research.coordination.strategies import STRATEGIES, hub_waiting
from slipstream_lab.research.coordination.threshold import best_threshold, release
from slipstream_lab.research.coordination.trips.corridor import corridor_freight
from slipstream_lab.research.coordination.trips.freight import Freight, FreightSegment, Trip


def one_segment(ready_s: list[int], slack_s: int = 60, price_kw: float = 0.0) -> CoordinationCase:
    """Trips of a carrier each over one segment."""
    segments = {"s": FreightSegment(1000.0, 10_000, 4.0, 1.0)}
    trips = tuple(
        Trip(f"t{k}", f"c{k}", ("s",), 1000 * at, 1000 * (at + slack_s) + 10_000)
        for k, at in enumerate(ready_s)
    )
    return build_case(Freight("day", segments, trips), price_kw, sync_window_s=3.0)


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.long if n == "local search" else ()) for n in STRATEGIES],
)
def test_plans_can_be_driven_and_are_the_same_again(name: str) -> None:
    """Nobody late; same case, same plan."""
    case = build_case(corridor_freight(40, 5, "ten"), 5.0, 3.0)
    plan = STRATEGIES[name](case)
    check(case, plan)
    assert (plan == STRATEGIES[name](case)).all()


def test_the_first_waits_for_the_second() -> None:
    """Those who are ready later lead by their default; who is out of reach stays alone."""
    case = one_segment([0, 40, 90, 300])
    for strategy in (pairwise_leaders, hub_waiting, local_search):
        outcome = evaluate(case, strategy(case))
        assert outcome.drafting_kwh == 5.0
        assert outcome.mean_wait_s in (pytest.approx(10.0), pytest.approx(12.5))


def test_no_wait_that_costs_more_than_it_saves() -> None:
    """40 s at 720 kW are 8 kWh, more than both save."""
    for strategy in (pairwise_leaders, hub_waiting, best_threshold, local_search):
        assert not strategy(one_segment([0, 40], price_kw=720.0)).any()


def test_leaders_gather_followers() -> None:
    """Three can join the fourth, two the third: the fourth leads."""
    case = one_segment([0, 20, 40, 55])
    assert pairwise_leaders(case)[:, 0].tolist() == [55_000, 35_000, 15_000, 0]


def test_release_by_number_and_by_time() -> None:
    """Two go as soon as there are two; who waits alone goes after the time, or when it must."""
    case = one_segment([0, 10, 30, 200])
    assert release(case, 2, 45_000, False)[:, 0].tolist() == [10_000, 0, 45_000, 45_000]
    assert release(case, 3, 25_000, False)[:, 0].tolist() == [25_000, 15_000, 25_000, 25_000]
    assert release(case, 9, 500_000, False)[:, 0].tolist() == [60_000, 50_000, 30_000, 60_000]


def test_the_best_answer_waits_at_a_hub_where_that_pays() -> None:
    """With one vehicle on the first segment and another on the second, later, it meets both."""
    segments = {
        "s": FreightSegment(1000.0, 10_000, 4.0, 1.0),
        "t": FreightSegment(1000.0, 10_000, 4.0, 1.0, stop_kwh=0.5),
    }
    trips = (
        Trip("a", "c", ("s", "t"), 0, 120_000),
        Trip("b", "c", ("s",), 20_000, 90_000),
        Trip("d", "c", ("t",), 60_000, 130_000),
    )
    case = build_case(Freight("day", segments, trips), 0.0, 3.0)
    schedule = Schedule(case, undelayed(case))
    schedule.remove(0)
    value, delays = schedule.best(0, Worth.to_all())
    assert delays.tolist() == [20_000, 50_000]
    assert value == pytest.approx(5 + 5 - 0.5)
    assert schedule.value_kwh(0, delays, Worth.to_all()) == pytest.approx(value)
    assert schedule.value_kwh(0, delays, Worth.equally_shared()) == pytest.approx(2.5 * 2 - 0.5)


def test_who_waits_follows_if_it_would_lose_as_the_leader() -> None:
    """A leader's 1 kWh is less than its wait of 2, a follower's 4 are more."""
    case = one_segment([0, 10], price_kw=720.0)
    plan = np.array([[10_000], [0]])
    assert evaluate(case, plan).carrier_kwh == pytest.approx((-1.0, 4.0))
    fair = nobody_worse_off(case, plan)
    assert fair.tolist() == [[10_001], [0]]
    assert evaluate(case, fair).carrier_kwh == pytest.approx((2.0, 1.0), abs=0.001)


def test_a_carrier_that_would_lose_does_not_wait() -> None:
    """Even a follower's 4 kWh are less than its wait of 4.5; its partner then drives alone, too."""
    case = one_segment([0, 10], price_kw=1620.0)
    plan = np.array([[10_000], [0]])
    assert min(evaluate(case, plan).carrier_kwh) == pytest.approx(-3.5)
    fair = nobody_worse_off(case, plan)
    assert not fair.any()
    assert min(evaluate(case, fair).carrier_kwh) == 0.0

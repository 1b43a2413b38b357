"""The bound is above every plan: above the best of all by enumeration, and above all strategies."""

from __future__ import annotations

from itertools import combinations_with_replacement, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipstream_lab.research.coordination.bound import upper_bound
from slipstream_lab.research.coordination.case import CoordinationCase, build_case
from slipstream_lab.research.coordination.plan import evaluate
from slipstream_lab.research.coordination.strategies import STRATEGIES
from slipstream_lab.research.coordination.trips.corridor import corridor_freight
from slipstream_lab.research.coordination.trips.freight import Freight, FreightSegment, Trip
from slipstream_lab.research.coordination.trips.region import region_freight

STEP_MS = 1000


@st.composite
def small_cases(draw: st.DrawFn, ring: bool = False) -> CoordinationCase:
    """Up to four trips on a road of up to three segments, two of which may have a hub; or round a
    ring of three, which takes a time that is no multiple of a bin.
    """
    count = 3 if ring else draw(st.integers(1, 3))
    names = [f"s{k}" for k in range(count)]
    segments = {
        name: FreightSegment(
            1000.0,
            draw(st.sampled_from((7000, 20_333 if ring else 20_000))),
            follower_kwh=draw(st.sampled_from((1.0, 3.0))),
            leader_kwh=draw(st.sampled_from((0.0, 0.5, 1.0))),
            stop_kwh=draw(st.sampled_from((None, 0.0, 0.7))) if k else None,
        )
        for k, name in enumerate(names)
    }
    trips = []
    for number in range(draw(st.integers(2, 4))):
        begin = draw(st.integers(0, count - 1))
        path = tuple(names[begin : draw(st.integers(begin + 1, count))])
        path += tuple(names[: draw(st.integers(0, begin))]) if ring and path[-1] == "s2" else ()
        ready_ms = STEP_MS * draw(st.integers(0, 9))
        slack_ms = STEP_MS * draw(st.integers(0, 4))
        latest_ms = ready_ms + slack_ms + sum(segments[name].duration_ms for name in path)
        trips.append(Trip(f"t{number}", "c", path, ready_ms, latest_ms))
    price_kw = draw(st.sampled_from((0.0, 400.0, 2000.0)))
    return build_case(Freight("small", segments, tuple(trips)), price_kw, sync_window_s=2.0)


def best_by_enumeration(case: CoordinationCase) -> float:
    """Over all waits in whole seconds, at origins and hubs."""
    width = case.stop_kwh.shape[1]
    choices = []
    for slack_ms, stops in zip(case.slack_ms.tolist(), case.stop_kwh, strict=True):
        stretches = int(np.isfinite(stops).sum())
        steps = range(0, slack_ms + 1, STEP_MS)
        rows = combinations_with_replacement(steps, stretches)
        choices.append([(*row, *[row[-1]] * (width - stretches)) for row in rows])
    total = 1
    for options in choices:
        total *= len(options)
    if total > 3000:
        # Fewer waits for the last trips: still plans, so the bound has to be above them.
        choices = [*choices[:2], *(options[:3] for options in choices[2:])]
        choices = [options[:25] for options in choices]
    return max(evaluate(case, np.array(plan)).net_kwh for plan in product(*choices))


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.one_of(small_cases(), small_cases(ring=True)))
def test_no_plan_is_above_the_bound(case: CoordinationCase) -> None:
    """Enumerated, with hubs, prices and vehicles that can meet within the window."""
    assert upper_bound(case, 40).kwh >= best_by_enumeration(case) - 1e-9


def test_two_that_can_meet_are_worth_a_leader_and_a_follower() -> None:
    """The bound is exact where there is one meeting: both ways round, for any number of steps."""
    segments = {"s": FreightSegment(1000.0, 10_000, 4.0, 1.0)}
    trips = (Trip("a", "c", ("s",), 0, 70_000), Trip("b", "c", ("s",), 30_000, 70_000))
    case = build_case(Freight("two", segments, trips), 0.0, 3.0)
    assert upper_bound(case).kwh == pytest.approx(5.0)


def test_who_can_meet_nobody_is_worth_nothing() -> None:
    """Two on one road, hours apart."""
    segments = {"s": FreightSegment(1000.0, 10_000, 4.0, 1.0)}
    trips = (Trip("a", "c", ("s",), 0, 70_000), Trip("b", "c", ("s",), 9_000_000, 9_070_000))
    case = build_case(Freight("two", segments, trips), 0.0, 3.0)
    assert upper_bound(case).kwh == pytest.approx(0.0)


@pytest.mark.long
@pytest.mark.parametrize("price_kw", [0.0, 10.0])
@pytest.mark.parametrize(
    "freight",
    [corridor_freight(60, 5, "one"), corridor_freight(60, 5, "ten"), region_freight(5, trucks=60)],
    ids=lambda freight: str(freight.name),
)
def test_no_strategy_is_above_the_bound(freight: Freight, price_kw: float) -> None:
    """All of them, on small days of each law; nobody late, no carrier worse off in ours."""
    case = build_case(freight, price_kw, 3.0)
    bound = upper_bound(case, 30).kwh
    worth = {name: evaluate(case, strategy(case)) for name, strategy in STRATEGIES.items()}
    assert max(outcome.net_kwh for outcome in worth.values()) <= bound + 1e-9
    assert min(worth["local search"].carrier_kwh) >= -1e-9
    fair = [o.net_kwh for o in worth.values() if min(o.carrier_kwh) >= -1e-9]
    assert worth["local search"].net_kwh == max(fair)
    assert worth["local search"].net_kwh > worth["as ready"].net_kwh

"""A plan's value, by hand, and that a plan which cannot be driven is refused."""

from __future__ import annotations

import numpy as np
import pytest

from slipstream_lab.research.coordination.case import CoordinationCase, build_case
from slipstream_lab.research.coordination.plan import check, evaluate, undelayed
from slipstream_lab.research.coordination.trips.freight import Freight, FreightSegment, Trip


def road(price_kw: float = 36.0) -> CoordinationCase:
    """Two segments with a hub between; a and b drive both, c the second one."""
    segments = {
        "closed": FreightSegment(500.0, 5_000, 2.0, 0.5, is_open=False),
        "s": FreightSegment(1000.0, 10_000, 4.0, 1.0),
        "t": FreightSegment(2000.0, 20_000, 8.0, 2.0, stop_kwh=0.25),
    }
    trips = (
        Trip("a", "x", ("closed", "s", "t"), 0, 135_000),
        Trip("b", "y", ("s", "t"), 25_000, 155_000),
        Trip("c", "y", ("t",), 60_000, 180_000),
    )
    return build_case(Freight("road", segments, trips), price_kw, sync_window_s=3.0)


def test_links_and_ceiling() -> None:
    """Each segment is a link, as c and the hub part them; the ceiling counts closed ones too."""
    case = road()
    assert case.follower_kwh.tolist() == [4.0, 8.0]
    assert case.link.tolist() == [[0, 1], [0, 1], [1, -1]]
    assert case.offset_ms[0].tolist() == [5_000, 15_000]
    assert case.slack_ms.tolist() == [100_000, 100_000, 100_000]
    assert case.stop_kwh[2].tolist() == [0.0, np.inf]
    assert case.ceiling_kwh == 2 + 12 + 12 + 8


def test_undelayed_nobody_meets() -> None:
    """Entries are further apart than the window."""
    outcome = evaluate(road(), undelayed(road()))
    assert outcome.net_kwh == 0.0
    assert outcome.platooned_km == 0.0
    assert outcome.open_km == pytest.approx(3 + 3 + 2)


def test_a_platoon_with_a_wait_at_the_hub() -> None:
    """a waits 20 s for b, both wait 25 s at the hub for c: 36 kW is 0.01 kWh a second."""
    case = road()
    plan = np.array([[20_000, 45_000], [0, 25_000], [0, 0]])
    outcome = evaluate(case, plan)
    # s: leader 1, follower 4. t: leader 2, two followers 8 each.
    assert outcome.drafting_kwh == pytest.approx(1 + 4 + 2 + 16)
    assert outcome.stops_kwh == pytest.approx(0.5)
    assert outcome.waiting_kwh == pytest.approx(0.45 + 0.25)
    assert outcome.platooned_km == pytest.approx(2 * 1 + 3 * 2)
    assert (outcome.mean_wait_s, outcome.max_wait_s) == (pytest.approx(70 / 3), 45.0)
    # All enter at once: the first of them by number leads.
    assert outcome.carrier_kwh == pytest.approx((1 + 2 - 0.25 - 0.45, 4 + 16 - 0.25 - 0.25))


@pytest.mark.parametrize(
    "plan",
    [
        [[-1, 0], [0, 0], [0, 0]],
        [[5, 4], [0, 0], [0, 0]],
        [[0, 100_001], [0, 0], [0, 0]],
        [[0, 0], [0, 0]],
    ],
)
def test_what_cannot_be_driven_is_refused(plan: list[list[int]]) -> None:
    """Negative waits, lateness, another shape."""
    with pytest.raises(ValueError, match=r"wait below 0|late|shape"):
        check(road(), np.array(plan, dtype=np.int64))

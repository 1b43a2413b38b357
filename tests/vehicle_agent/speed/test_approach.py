"""Who waits at a leg's signals, which green is taken, and what time is worth on a leg."""

import pytest

from slipstream.messages import SensedVehicle
from tests.vehicle_agent.road import crossing, leg, segment
from vehicle_agent.signals import Green
from vehicle_agent.speed.approach import arrival_speed_mps, choose_arrival_s
from vehicle_agent.speed.coasting import CoastingModel
from vehicle_agent.speed.lead_vehicle import queue_length
from vehicle_agent.speed.value_of_time import (
    leg_value_of_time_w,
    limit_before,
    revealed_value_of_time_w,
)

ROAD = leg(
    segment("a", 100.0, onward=crossing(length_m=12.0, speed_mps=6.5, groups=((0, 4),))),
    segment("b", 200.0, 8.0, onward=crossing(length_m=10.0, yields=True)),
    segment("c", 300.0),
)
CAR = CoastingModel.of()


def lead(gap_m: float, speed_mps: float) -> SensedVehicle:
    """A vehicle ahead, from bumper to bumper."""
    return SensedVehicle(track="x", vehicle=None, gap_m=gap_m, speed_mps=speed_mps)


def test_the_limit_before_a_place_is_that_of_its_segment() -> None:
    """At a segment's begin, still that of the one before."""
    assert [limit_before(ROAD, at) for at in (100.0, 112.0, 312.0, 622.0)] == [
        13.4,
        13.4,
        8.0,
        13.4,
    ]


def test_a_tighter_budget_makes_time_dearer() -> None:
    """The price is the revealed one at least, and what rolling costs at it fits the budget."""
    prices = [leg_value_of_time_w(ROAD, budget_s, CAR, 1.5) for budget_s in (1e3, 2.0, 0.5)]
    assert prices[0] == pytest.approx(revealed_value_of_time_w(ROAD))
    assert prices[0] < prices[1] < prices[2]
    lost_s = sum(
        CAR.lost_s(limit_before(ROAD, slow.at_m), slow.speed_mps, prices[1], 1.5)
        for slow in ROAD.slow
    )
    assert lost_s == pytest.approx(2.0, abs=1e-3)


def test_a_queue_is_counted_back_from_its_last_vehicle() -> None:
    """Vehicles stand 7.1 m apart; who moves, or stands behind the line, does not wait."""
    assert queue_length(None, 80.0) == 0
    assert queue_length(lead(80.0 - 4.6, 0.0), 80.0) == 1
    assert queue_length(lead(80.0 - 4.6 - 14.2, 0.0), 80.0) == 3
    assert queue_length(lead(32.5, 5.0), 80.0) == 0
    assert queue_length(lead(97.5, 0.0), 80.0) == 0


def test_the_green_that_is_taken_holds_the_platoon_and_its_margins() -> None:
    """Certain greens must last for the tail; uncertain ones have a later begin and no end."""
    certain = (Green(0.0, 20.0, True, True), Green(50.0, 70.0, True, True))

    def chosen(greens: tuple[Green, ...], tail_s: float = 0.0, queue: int = 0) -> float | None:
        return choose_arrival_s(greens, 10.0, 15.0, tail_s, queue)

    assert chosen(certain) == 15.0
    assert chosen(certain, tail_s=5.0) == 51.5
    assert chosen(certain[1:], queue=2) == 55.5
    assert chosen(certain, tail_s=30.0) is None
    assert chosen((Green(40.0, 45.0, False, True),)) == 43.0
    assert chosen((Green(0.0, 12.0, False, True),)) == 15.0
    assert chosen(()) is None


def test_the_approach_takes_its_time_and_is_not_a_crawl() -> None:
    """Rolling from the advised speed covers the distance in the time; slower ones are held."""
    speed = arrival_speed_mps(CAR, 200.0, 20.0)
    assert speed is not None
    ends = CAR.after(speed, 20.0)
    assert CAR.distance_m(speed, ends) == pytest.approx(200.0, abs=1e-6)
    assert arrival_speed_mps(CAR, 300.0, 55.0) == pytest.approx(300.0 / 55.0)
    assert arrival_speed_mps(CAR, 200.0, 60.0) is None

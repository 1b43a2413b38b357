"""A leg's road, who waits at its signals, and which green is taken."""

import pytest

from simulation.controllers.advice.approach import Margins, arrival_speed_mps, choose_arrival_s
from simulation.controllers.advice.coasting import CoastingModel
from simulation.controllers.advice.radar import LeadVehicle, queue_length
from simulation.controllers.advice.road import YIELDING_MPS, Crossing, Roads, SlowPoint, leg_road
from simulation.controllers.advice.value_of_time import (
    leg_value_of_time_w,
    limit_before,
    revealed_value_of_time_w,
)
from simulation.controllers.signals.program import Green
from simulation.controllers.vehicle import VehicleState

ROADS = Roads(
    {"a": 100.0, "b": 200.0, "c": 300.0},
    {"a": 13.4, "b": 8.0, "c": 13.4},
    {
        ("a", "b"): {0: Crossing(12.0, 6.5, "signal", 4), 1: Crossing(15.0, 9.0, "signal", 5)},
        ("b", "c"): {0: Crossing(10.0, 13.4, None, -1, yields=True)},
    },
)
CAR = CoastingModel.of()


def test_a_legs_road_has_turns_lower_limits_signals_and_its_end() -> None:
    """Places are counted along segments and junctions; a straight way that yields is slow too."""
    road = leg_road(ROADS, ("a", "b", "c"))
    assert road.begins_m == (0.0, 112.0, 322.0)
    assert road.length_m == 622.0
    assert road.slow == (
        SlowPoint(100.0, 6.5),
        SlowPoint(312.0, YIELDING_MPS),
        SlowPoint(622.0, 0.0),
    )
    assert [(line.at_m, line.tls, line.link) for line in road.lines] == [(100.0, "signal", 4)]
    assert leg_road(ROADS, ("a", "b", "c"), {0: 1}).lines[0].link == 5
    assert leg_road(ROADS, ("a", "b"), {0: 1}).slow[:2] == (
        SlowPoint(100.0, 9.0),
        SlowPoint(115.0, 8.0),
    )


def test_a_vehicles_place_is_on_its_segment_or_in_the_junction_behind_it() -> None:
    """In a junction the front is counted from the stop line on."""
    road = leg_road(ROADS, ("a", "b", "c"))
    assert road.place_m(VehicleState("b", 1, False, 0, 50.0, 5.0, 0.0)) == 162.0
    assert road.place_m(VehicleState("a", 0, True, 0, 5.0, 5.0, 0.0)) == 105.0
    assert road.slow_ahead(312.0) == (SlowPoint(622.0, 0.0),)
    assert [limit_before(road, at) for at in (100.0, 312.0, 622.0)] == [13.4, 8.0, 13.4]


def test_a_tighter_budget_makes_time_dearer() -> None:
    """The price is the revealed one at least, and what rolling costs at it fits the budget."""
    road = leg_road(ROADS, ("a", "b", "c"))
    prices = [leg_value_of_time_w(road, budget_s, CAR, 1.5) for budget_s in (1e3, 2.0, 0.5)]
    assert prices[0] == pytest.approx(revealed_value_of_time_w(road))
    assert prices[0] < prices[1] < prices[2]
    lost_s = sum(
        CAR.lost_s(limit_before(road, slow.at_m), slow.speed_mps, prices[1], 1.5)
        for slow in road.slow
    )
    assert lost_s == pytest.approx(2.0, abs=1e-3)


def test_a_queue_is_counted_back_from_its_last_vehicle() -> None:
    """Vehicles stand 7.1 m apart; who moves, or stands behind the line, does not wait."""
    assert queue_length(None, 80.0) == 0
    assert queue_length(LeadVehicle("x", 80.0 - 2.5 - 4.6, 0.0), 80.0) == 1
    assert queue_length(LeadVehicle("x", 80.0 - 2.5 - 4.6 - 14.2, 0.0), 80.0) == 3
    assert queue_length(LeadVehicle("x", 30.0, 5.0), 80.0) == 0
    assert queue_length(LeadVehicle("x", 95.0, 0.0), 80.0) == 0


def test_the_green_that_is_taken_holds_the_platoon_and_its_margins() -> None:
    """Certain greens must last for the tail; uncertain ones have a later begin and no end."""
    certain = (Green(0.0, 20.0, True, True), Green(50.0, 70.0, True, True))
    margins = Margins(certain_s=1.5, uncertain_s=3.0, queued_s=2.0)

    def chosen(greens: tuple[Green, ...], tail_s: float = 0.0, queue: int = 0) -> float | None:
        return choose_arrival_s(greens, 10.0, 15.0, tail_s, queue, margins)

    assert chosen(certain) == 15.0
    assert chosen(certain, tail_s=5.0) == 51.5
    assert chosen(certain[1:], queue=2) == 55.5
    assert chosen(certain, tail_s=30.0) is None
    assert chosen((Green(40.0, 45.0, False, True),)) == 43.0
    assert chosen((Green(0.0, 12.0, False, True),)) == 15.0
    assert chosen(()) is None


def test_the_approach_takes_its_time_and_is_not_a_crawl() -> None:
    """Rolling from the advised speed covers the distance in the time; slower ones are held."""
    speed = arrival_speed_mps(CAR, 200.0, 20.0, 5.0)
    assert speed is not None
    ends = CAR.after(speed, 20.0)
    assert CAR.distance_m(speed, ends) == pytest.approx(200.0, abs=1e-6)
    assert arrival_speed_mps(CAR, 300.0, 55.0, 5.0) == pytest.approx(300.0 / 55.0)
    assert arrival_speed_mps(CAR, 200.0, 60.0, 5.0) is None

"""Speed advice as a whole, on a road of two segments with a signal between them."""

from dataclasses import dataclass, replace

import pytest

from simulation.controllers.advice.advisor import SpeedAdvisor
from simulation.controllers.advice.radar import LeadVehicle, Radar
from simulation.controllers.advice.road import Crossing, Roads
from simulation.controllers.vehicle import LegOrder, VehicleState
from slipstream.messages import DrivingAdvice

LIMIT = 13.4


def nobody(name: str) -> LeadVehicle | None:
    """A radar before an empty road."""
    return None


ROADS = Roads(
    {"a": 400.0, "b": 600.0},
    {"a": LIMIT, "b": LIMIT},
    {("a", "b"): {0: Crossing(20.0, LIMIT, "signal", 3)}},
)


@dataclass(frozen=True)
class Green:
    """A green window."""

    begin_s: float
    end_s: float
    certain: bool = True


@dataclass(frozen=True)
class Timing:
    """A signal whose greens are these, whatever the time."""

    greens: tuple[Green, ...] = ()

    def upcoming(self, tls: str, link: int, now_s: float) -> tuple[Green, ...]:
        """The greens that have not ended."""
        assert (tls, link) == ("signal", 3)
        return tuple(green for green in self.greens if green.end_s > now_s)


def order(*, eco: bool = False, coasting: float = 0.0) -> LegOrder:
    """A leg over both segments."""
    advice = DrivingAdvice(eco_approach=eco, coasting_budget=coasting)
    return LegOrder("van", 0, 0, ("a", "b"), 0.0, 0.0, 76.0, (), advice)


def drive(
    leg: LegOrder, timing: Timing, *, tail_m: float = 0.0, radar: Radar = nobody
) -> tuple[list[float], list[float], dict[str, float]]:
    """Drive a leg by its advice alone; speeds, places and times at the stop line and the end."""
    advisor = SpeedAdvisor(ROADS, timing, 0.5, radar=radar)
    advisor.departed(leg.id, leg)
    now = place = speed = 0.0
    speeds, places = [speed], [place]
    times: dict[str, float] = {}
    while place < 1019.0 and now < 300:
        number, crossing = (0, False) if place < 400 else (1, False) if place >= 420 else (0, True)
        front = place - (0.0 if place < 400 else 420.0 if place >= 420 else 400.0)
        state = VehicleState("ab"[number], number, crossing, 0, front, speed, place)
        cap = advisor.cap_mps(leg.id, now, state, tail_m)
        wanted = min(LIMIT, (2 * 1.5 * (1020.0 - place)) ** 0.5, cap if cap is not None else LIMIT)
        after = max(0.0, min(speed + 0.9, max(speed - 1.25, wanted)))
        now, place, speed = now + 0.5, place + 0.25 * (speed + after), after
        speeds.append(speed)
        places.append(place)
        if place >= 400:
            times.setdefault("line", now)
    times["end"] = now
    advisor.ended(leg.id)
    return speeds, places, times


def test_no_advice_is_free_driving() -> None:
    """Without either part, and for vehicles that never departed, there is no cap."""
    advisor = SpeedAdvisor(ROADS, Timing(), 0.5, radar=nobody)
    leg = order()
    advisor.departed(leg.id, leg)
    state = VehicleState("a", 0, False, 0, 10.0, 5.0, 10.0)
    assert advisor.cap_mps(leg.id, 0.0, state) is None
    assert advisor.cap_mps("cav/other/0/0", 0.0, state) is None


def test_red_is_passed_at_green_without_stopping() -> None:
    """With a known next green, a vehicle reaches the line within it, still rolling."""
    speeds, places, times = drive(order(eco=True), Timing((Green(45.0, 80.0),)))
    assert 46.0 <= times["line"] <= 50.0
    on_the_way = [v for v, x in zip(speeds, places, strict=True) if 100 < x < 400]
    assert min(on_the_way) > 5.0


def test_a_platoon_that_does_not_fit_waits_for_the_next_green() -> None:
    """The tail must pass before the end: a long platoon takes the next green, a lone one this."""
    timing = Timing((Green(0.0, 38.0), Green(60.0, 98.0)))
    assert drive(order(eco=True), timing)[2]["line"] < 38.0
    assert drive(order(eco=True), timing, tail_m=120.0)[2]["line"] > 61.0


def test_unknown_signals_change_nothing() -> None:
    """Where nothing is broadcast a vehicle drives as if there were no advice."""
    assert drive(order(eco=True), Timing()) == drive(order(), Timing())


@pytest.mark.parametrize("share", [0.01, 0.03, 0.1])
def test_coasting_keeps_to_its_budget(share: float) -> None:
    """Rolling out adds no more time than its share of the leg's planned time, and some."""
    free = drive(order(), Timing())[2]["end"]
    rolled = drive(order(coasting=share), Timing())[2]["end"]
    assert 0 < rolled - free <= share * 76.0 + 1.5


def test_with_no_seconds_left_nobody_coasts() -> None:
    """An account that is empty at the begin gives no advice."""
    leg = replace(order(coasting=0.1), free_s=0.0)
    assert drive(leg, Timing()) == drive(order(), Timing())


def test_another_way_keeps_the_account() -> None:
    """A vehicle that is given another way does not get its budget of seconds again."""
    leg = order(coasting=0.02)
    advisor = SpeedAdvisor(ROADS, Timing(), 0.5, radar=nobody)
    advisor.departed(leg.id, leg)

    def advised() -> int:
        state = VehicleState("b", 1, False, 0, 570.0, 9.0, 990.0)
        caps = [advisor.cap_mps(leg.id, 0.0, state) for _ in range(200)]
        return sum(cap is not None for cap in caps)

    assert 0 < advised() < 200
    advisor.departed(leg.id, leg)
    assert advised() == 0
    advisor.ended(leg.id)
    advisor.departed(leg.id, leg)
    assert advised() > 0


def test_a_queue_at_the_line_is_given_time_to_leave() -> None:
    """Who sees vehicles wait at the stop line approaches more slowly than an empty one."""

    def queue(name: str) -> LeadVehicle | None:
        return LeadVehicle("ahead", 70.0, 0.0)

    def cap_mps(radar: Radar) -> float:
        advisor = SpeedAdvisor(ROADS, Timing((Green(40.0, 80.0),)), 0.5, radar=radar)
        leg = order(eco=True)
        advisor.departed(leg.id, leg)
        state = VehicleState("a", 0, False, 0, 300.0, 9.0, 300.0)
        cap = advisor.cap_mps(leg.id, 30.0, state)
        assert cap is not None
        return cap

    assert cap_mps(queue) < cap_mps(nobody) - 0.3


def test_nobody_speeds_up_behind_a_slower_vehicle() -> None:
    """A vehicle that closes in on a slower one rolls; one that falls back is left alone."""

    def cap(ahead_mps: float) -> float | None:
        def slower(name: str) -> LeadVehicle | None:
            return LeadVehicle("ahead", 30.0, ahead_mps)

        advisor = SpeedAdvisor(ROADS, Timing(), 0.5, radar=slower)
        leg = order(eco=True)
        advisor.departed(leg.id, leg)
        state = VehicleState("a", 0, False, 0, 100.0, 12.0, 100.0)
        advisor.cap_mps(leg.id, 10.0, state)
        return advisor.cap_mps(leg.id, 10.5, state)

    behind = cap(7.0)
    assert behind is not None
    assert 11.8 < behind < 12.0
    assert cap(12.5) is None


def test_who_cannot_stop_for_a_yellow_light_is_not_told_to_slow_down() -> None:
    """Near the line the advice to roll on to the next green would end in the red one."""
    leg = order(eco=True, coasting=0.06)
    advisor = SpeedAdvisor(ROADS, Timing((Green(40.0, 80.0),)), 0.5, radar=nobody)
    advisor.departed(leg.id, leg)

    def cap(ahead_m: float) -> float | None:
        place_m = 400.0 - ahead_m
        return advisor.cap_mps(leg.id, 20.0, VehicleState("a", 0, False, 0, place_m, 12.0, place_m))

    assert cap(30.0) is None
    slowed = cap(60.0)
    assert slowed is not None
    assert slowed < 12.0

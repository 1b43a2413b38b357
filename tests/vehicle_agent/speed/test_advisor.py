"""Speed advice as a whole, on a road of two segments with a signal between them."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from slipstream.messages import DrivingAdvice, SensedVehicle
from tests.vehicle_agent.road import Told, course, spat, timings, with_signal
from vehicle_agent.leg import VehicleState
from vehicle_agent.signals import SignalTimings
from vehicle_agent.speed import SpeedAdvisor

LIMIT = 13.4
ROAD = with_signal()
Radar = Callable[[], SensedVehicle | None]


def nobody() -> SensedVehicle | None:
    """A radar before an empty road."""
    return None


def advice(*, eco: bool = False, coasting: float = 0.0) -> DrivingAdvice:
    """Of a plan."""
    return DrivingAdvice(eco_approach=eco, coasting_budget=coasting)


def advisor(*told: Told, plan: DrivingAdvice, time_s: float = 0.0) -> SpeedAdvisor:
    """Of a vehicle that has begun its leg and heard this."""
    found = SpeedAdvisor(timings(spat(time_s, *told)) if told else SignalTimings(), 0.5)
    found.begin(ROAD, plan)
    return found


def drive(
    plan: DrivingAdvice, *told: Told, tail_m: float = 0.0
) -> tuple[list[float], list[float], dict[str, float]]:
    """Drive a leg by its advice alone; speeds, places and times at the stop line and the end."""
    heard = SignalTimings()
    agent = SpeedAdvisor(heard, 0.5)
    agent.begin(ROAD, plan)
    now = place = speed = 0.0
    speeds, places = [speed], [place]
    times: dict[str, float] = {}
    while place < 1019.0 and now < 300:
        if told:
            heard.receive(spat(now, *told))
        number, crossing = (0, False) if place < 400 else (1, False) if place >= 420 else (0, True)
        front = place - (0.0 if place < 400 else 420.0 if place >= 420 else 400.0)
        state = VehicleState("ab"[number], number, crossing, 0, front, speed)
        cap = agent.cap_mps(now, state, None, tail_m)
        wanted = min(LIMIT, (2 * 1.5 * (1020.0 - place)) ** 0.5, cap if cap is not None else LIMIT)
        after = max(0.0, min(speed + 0.9, max(speed - 1.25, wanted)))
        now, place, speed = now + 0.5, place + 0.25 * (speed + after), after
        speeds.append(speed)
        places.append(place)
        if place >= 400:
            times.setdefault("line", now)
    times["end"] = now
    return speeds, places, times


def on(front_m: float, speed_mps: float, number: int = 0) -> VehicleState:
    """On one of the two segments."""
    return VehicleState("ab"[number], number, False, 0, front_m, speed_mps)


def test_no_advice_is_free_driving() -> None:
    """Without either part, before a leg begins, and after it has ended, there is no cap."""
    agent = SpeedAdvisor(SignalTimings(), 0.5)
    assert agent.cap_mps(0.0, on(10.0, 5.0), None) is None
    agent.begin(ROAD, advice())
    assert agent.cap_mps(0.0, on(10.0, 5.0), None) is None
    agent.begin(ROAD, advice(coasting=0.1))
    assert agent.cap_mps(0.0, on(570.0, 9.0, 1), None) is not None
    agent.end()
    assert agent.cap_mps(0.0, on(570.0, 9.0, 1), None) is None


def test_red_is_passed_at_green_without_stopping() -> None:
    """With a known next green, a vehicle reaches the line within it, still rolling."""
    speeds, places, times = drive(advice(eco=True), *course((45.0, 80.0)))
    assert 46.0 <= times["line"] <= 50.0
    on_the_way = [v for v, x in zip(speeds, places, strict=True) if 100 < x < 400]
    assert min(on_the_way) > 5.0


def test_a_platoon_that_does_not_fit_waits_for_the_next_green() -> None:
    """The tail must pass before the end: a long platoon takes the next green, a lone one this."""
    told = course((0.0, 38.0), (60.0, 98.0))
    assert drive(advice(eco=True), *told)[2]["line"] < 38.0
    assert drive(advice(eco=True), *told, tail_m=120.0)[2]["line"] > 61.0


def test_unknown_signals_change_nothing() -> None:
    """Where nothing is told, or has become stale, it drives as if there were no advice."""
    assert drive(advice(eco=True)) == drive(advice())
    stale = advisor(*course((45.0, 80.0)), plan=advice(eco=True))
    assert stale.cap_mps(1.0, on(300.0, 12.0), None) is not None
    assert stale.cap_mps(2.1, on(300.0, 12.0), None) is None


@pytest.mark.parametrize("share", [0.01, 0.03, 0.1])
def test_coasting_keeps_to_its_budget(share: float) -> None:
    """Rolling out adds no more time than its share of the leg's planned time, and some."""
    free = drive(advice())[2]["end"]
    rolled = drive(advice(coasting=share))[2]["end"]
    assert 0 < rolled - free <= share * 86.0 + 1.5


def test_another_way_keeps_the_account_and_another_leg_does_not() -> None:
    """A vehicle that is given another way does not get its budget of seconds again."""
    agent = advisor(plan=advice(coasting=0.02))

    def advised() -> int:
        caps = [agent.cap_mps(0.0, on(570.0, 9.0, 1), None) for _ in range(200)]
        return sum(cap is not None for cap in caps)

    assert 0 < advised() < 200
    agent.begin(with_signal(410.0), advice(coasting=0.02))
    assert advised() == 0
    agent.end()
    agent.begin(ROAD, advice(coasting=0.02))
    assert advised() > 0


def test_a_queue_at_the_line_is_given_time_to_leave() -> None:
    """Who sees vehicles wait at the stop line approaches more slowly than an empty one."""

    def cap_mps(ahead: SensedVehicle | None) -> float:
        agent = advisor(*course((40.0, 80.0)), plan=advice(eco=True), time_s=30.0)
        cap = agent.cap_mps(30.0, on(300.0, 9.0), ahead)
        assert cap is not None
        return cap

    queue = SensedVehicle(track="ahead", vehicle=None, gap_m=72.5, speed_mps=0.0)
    assert cap_mps(queue) < cap_mps(None) - 0.3


def test_nobody_speeds_up_behind_a_slower_vehicle() -> None:
    """A vehicle that closes in on a slower one rolls; one that falls back is left alone."""

    def cap(ahead_mps: float, tracks: str) -> float | None:
        agent = advisor(plan=advice(eco=True))
        caps = [
            agent.cap_mps(
                10.0 + 0.5 * i,
                on(100.0, 12.0),
                SensedVehicle(track=track, vehicle=None, gap_m=32.5, speed_mps=ahead_mps),
            )
            for i, track in enumerate(tracks)
        ]
        return caps[-1]

    behind = cap(7.0, "aa")
    assert behind is not None
    assert 11.8 < behind < 12.0
    assert cap(12.5, "aa") is None
    assert cap(7.0, "ab") is None


def test_who_cannot_stop_for_a_yellow_light_is_not_told_to_slow_down() -> None:
    """Near the line the advice to roll on to the next green would end in the red one."""

    def cap(ahead_m: float) -> float | None:
        agent = advisor(*course((40.0, 80.0)), plan=advice(eco=True, coasting=0.06), time_s=20.0)
        return agent.cap_mps(20.0, on(400.0 - ahead_m, 12.0), None)

    assert cap(30.0) is None
    slowed = cap(60.0)
    assert slowed is not None
    assert slowed < 12.0

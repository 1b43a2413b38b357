"""A drive through known signals is foreseen, and the second that suits them best is found."""

from __future__ import annotations

import math

import pytest

from tests.vehicle_agent.road import course, crossing, leg, segment, spat, timings, with_signal
from vehicle_agent.signals import Green, LegDeparture
from vehicle_agent.signals.departure import way_of
from vehicle_agent.signals.predicted_drive import (
    Movement,
    RoadPart,
    drive_on,
    predict_drive,
    wait_s,
)

MOVEMENT = Movement("signal", 0)
ALWAYS = (Green(0.0, math.inf, True, True),)


def test_the_closed_forms_are_the_idms_own_integral() -> None:
    """Speed, time and ∫v² ds of a kilometre from rest agree with small steps of the IDM."""
    v, s, t, squares, dt = 0.0, 0.0, 0.0, 0.0, 1e-3
    while s < 1000.0:
        after = v + 1.8 * (1 - (v / 13.4) ** 4) * dt
        s += 0.5 * (v + after) * dt
        squares += (0.5 * (v + after)) ** 3 * dt
        v, t = after, t + dt
    gain = drive_on(0.0, 13.4, 1000.0)
    assert gain.speed_mps == pytest.approx(v, rel=2e-3)
    assert gain.seconds == pytest.approx(t, rel=2e-3)
    assert gain.squares_m3ps2 == pytest.approx(squares, rel=2e-3)


def test_a_drive_is_the_same_in_one_stretch_and_in_many() -> None:
    """Cutting a road into pieces changes neither time nor energy."""
    whole = predict_drive([RoadPart(800.0, 13.4)], 0.0, lambda _: ())
    cut = predict_drive([RoadPart(200.0, 13.4)] * 4, 0.0, lambda _: ())
    assert cut.duration_s == pytest.approx(whole.duration_s, abs=0.1)
    assert cut.energy_kwh == pytest.approx(whole.energy_kwh, rel=0.01)


def test_a_red_signal_costs_a_stop_and_its_wait() -> None:
    """Against green all the time: the wait, about the kinetic energy."""
    way = [RoadPart(500.0, 13.4, MOVEMENT), RoadPart(500.0, 13.4)]
    free = predict_drive(way, 0.0, lambda _: ALWAYS)
    red = predict_drive(way, 0.0, lambda _: (Green(70.0, 100.0, True, True),))
    assert 20.0 < red.duration_s - free.duration_s < 45.0
    assert 0.03 < red.energy_kwh - free.energy_kwh < 0.06


def test_waits_hang_on_the_windows() -> None:
    """Before a green, in it, just behind it, between two, and where nothing is known."""
    greens = (Green(10.0, 20.0, True, True), Green(50.0, 60.0, True, False))
    assert wait_s(greens, 5.0) == (6.5, True)
    assert wait_s(greens, 11.0) == (0.5, True)
    assert wait_s(greens, 15.0) == (0.0, True)
    assert wait_s(greens, 20.9) == (0.0, True)
    assert wait_s(greens, 30.0) == (21.5, False)
    assert wait_s(greens, 90.0) == (4.0, False)


ROAD = with_signal()


def test_the_second_is_chosen_by_the_signal_on_the_way() -> None:
    """The first of the best seconds; none where nothing is known or time is up."""
    told = timings(spat(0.0, *course((60.0, 90.0))))
    choice = LegDeparture(told)
    assert choice.best_s(ROAD, 0.0, 32.0, 3000.0) == 28.0
    assert choice.best_s(ROAD, 0.0, 3.0, 3000.0) == 0.0
    assert LegDeparture(timings()).best_s(ROAD, 0.0, 32.0, 3000.0) == 0.0


def test_a_leg_is_driven_segment_by_segment_and_through_its_junctions() -> None:
    """With the movement at the line, and slowly where the vehicle gives way."""
    road = leg(
        segment("a", 100.0, onward=crossing(length_m=12.0, speed_mps=6.5, groups=((0, 4),))),
        segment("b", 200.0, 8.0, onward=crossing(length_m=10.0, yields=True)),
        segment("c", 300.0),
    )
    assert way_of(road, 0.5) == (
        RoadPart(100.0, 6.7, Movement("signal", 4)),
        RoadPart(12.0, 4.0),
        RoadPart(200.0, 4.0, None, 3.0),
        RoadPart(10.0, 6.7),
        RoadPart(300.0, 6.7),
    )

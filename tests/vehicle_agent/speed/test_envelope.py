"""No advice is above the limit, past a red line, or nearer than a safe gap, whatever was told."""

from __future__ import annotations

import math
from itertools import compress

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from slipstream.messages import PhaseState, SensedVehicle
from tests.vehicle_agent.road import Told, crossing, leg, segment, spat, timings, with_signal
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.signals import SignalTimings
from vehicle_agent.speed.envelope import (
    FULL_MPS2,
    HARD_MPS2,
    RESPONSE_S,
    Ceiling,
    braked_after_mps,
    ceiling,
)

NOTHING = SignalTimings()
SIGNAL = with_signal()
GREEN: PhaseState = "protected-Movement-Allowed"
YELLOW: PhaseState = "protected-clearance"
RED: PhaseState = "stop-And-Remain"

ANY = st.floats(0, allow_nan=False, allow_infinity=False)
SPEEDS = st.floats(0, 60)
INTERVALS = st.sampled_from([0.1, 0.5])
STATES = st.sampled_from(
    [
        *("dark", "stop-And-Remain", "pre-Movement", "permissive-Movement-Allowed"),
        *("protected-Movement-Allowed", "permissive-clearance", "protected-clearance"),
    ]
)
ROADS = st.builds(
    lambda lengths, limits, turn, yields: leg(
        segment(
            "a",
            lengths[0],
            limits[0],
            crossing(speed_mps=turn, yields=yields, groups=() if yields else ((0, 3),)),
        ),
        segment("b", lengths[1], limits[1]),
    ),
    st.tuples(st.floats(1, 2000), st.floats(1, 2000)),
    st.tuples(st.floats(1, 40), st.floats(1, 40)),
    st.floats(1, 40),
    st.booleans(),
)


def on(place_m: float, speed_mps: float, road: Leg = SIGNAL) -> VehicleState:
    """At a place of a leg of two segments."""
    if place_m <= road.ends_m[0]:
        return VehicleState("a", 0, False, 0, place_m, speed_mps)
    if place_m < road.begins_m[1]:
        return VehicleState("a", 0, True, 0, place_m - road.ends_m[0], speed_mps)
    return VehicleState("b", 1, False, 0, place_m - road.begins_m[1], speed_mps)


def before_signal(
    ahead_m: float, speed_mps: float, *told: Told, interval_s: float = 0.5
) -> Ceiling:
    """A vehicle so far before the stop line, at second 100 of what was told."""
    heard = timings(spat(100.0, *told))
    return ceiling(SIGNAL, on(400.0 - ahead_m, speed_mps), heard, 100.0, interval_s, None)


def stops_within_m(speed_mps: float, after_mps: float, interval_s: float, braking: float) -> float:
    """Way from now to rest: to the new speed within the interval, then braking."""
    driven_m = max(after_mps, 0.5 * (speed_mps + after_mps)) * interval_s
    return driven_m + after_mps * after_mps / (2 * braking)


@pytest.mark.slow
@given(
    front_m=ANY,
    speed_mps=ANY,
    number=st.integers(0, 1),
    crossing=st.booleans(),
    lane=st.integers(0, 2**62),
    road=ROADS,
    gap_m=st.none() | st.floats(allow_nan=False, allow_infinity=False),
    ahead_mps=ANY,
    told=st.lists(st.tuples(STATES, *[st.integers(0, 2**62)] * 3), max_size=4),
    interval_s=INTERVALS,
)
def test_never_above_the_limit_whatever_the_messages_say(
    front_m: float,
    speed_mps: float,
    number: int,
    crossing: bool,
    lane: int,
    road: Leg,
    gap_m: float | None,
    ahead_mps: float,
    told: list[tuple[PhaseState, int, int, int]],
    interval_s: float,
) -> None:
    """All values at their limits: a number from 0 to what is allowed there."""
    state = VehicleState("ab"[number], number, crossing, lane, front_m, speed_mps)
    ahead = None
    if gap_m is not None:
        ahead = SensedVehicle(track="x", vehicle=None, gap_m=gap_m, speed_mps=ahead_mps)
    events = [(s, begin / 1e9, a / 1e9, (a + b) / 1e9) for s, begin, a, b in told]
    heard = timings(spat(100.0, *[e for e in events if e[3] < 9e9]))
    found = ceiling(road, state, heard, 100.0, interval_s, ahead)
    onward = road.planned[number].crossing if crossing else None
    allowed = road.limits_mps[number] if onward is None else onward.speed_mps
    assert 0 <= found.speed_mps <= allowed


@given(
    speed_mps=SPEEDS,
    share=st.floats(0, 1),
    road=ROADS,
    interval_s=INTERVALS,
)
def test_what_can_be_braked_for_still_can_be(
    speed_mps: float, share: float, road: Leg, interval_s: float
) -> None:
    """Lower limits, turns, places to give way and the end: after the interval as before it."""
    state = on(share * road.length_m, speed_mps, road)
    place_m = road.place_m(state)
    top = ceiling(road, state, NOTHING, 0.0, interval_s, None).speed_mps
    ahead = [(slow, slow.at_m - place_m) for slow in road.slow_ahead(place_m)]
    rooms = [2 * HARD_MPS2 * ahead_m + slow.speed_mps * slow.speed_mps for slow, ahead_m in ahead]
    can = [speed_mps * speed_mps <= room for room in rooms]
    for (slow, ahead_m), room in compress(zip(ahead, rooms, strict=True), can):
        if all(can):  # else it brakes harder for the one that it cannot brake for
            assert top >= min(speed_mps - HARD_MPS2 * interval_s, slow.speed_mps) - 1e-6
        driven_m = max(top, 0.5 * (speed_mps + top)) * interval_s
        if driven_m < ahead_m:
            assert top * top <= room - 2 * HARD_MPS2 * driven_m + 1e-6
        else:
            assert top <= slow.speed_mps + 1e-6


@given(
    ahead_m=st.floats(0.01, 399.0),
    speed_mps=SPEEDS,
    state=st.sampled_from([RED, YELLOW, "pre-Movement", "permissive-clearance"]),
    end_s=st.floats(100.1, 200.0),
    fixed=st.booleans(),
    interval_s=INTERVALS,
)
def test_no_red_line_must_be_passed(
    ahead_m: float,
    speed_mps: float,
    state: PhaseState,
    end_s: float,
    fixed: bool,
    interval_s: float,
) -> None:
    """Who can stop before a line without green still can after the interval, however it is told."""
    assume(speed_mps * speed_mps <= 2 * HARD_MPS2 * ahead_m)
    told: list[Told] = [
        (state, 90.0, end_s, end_s if fixed else None),
        (GREEN, end_s, end_s + 30.0, end_s + 30.0 if fixed else None),
    ]
    found = before_signal(ahead_m, speed_mps, *told, interval_s=interval_s)
    top = found.speed_mps
    assert not found.signal_unknown
    assert stops_within_m(speed_mps, top, interval_s, HARD_MPS2) <= ahead_m + 1e-6
    assert top >= min(13.4, speed_mps - HARD_MPS2 * interval_s) - 1e-6


@pytest.mark.slow
@given(ahead_m=st.floats(5.0, 300.0), speed_mps=st.floats(0, 13.4), interval_s=INTERVALS)
def test_driving_by_the_ceiling_ends_before_a_red_line(
    ahead_m: float, speed_mps: float, interval_s: float
) -> None:
    """Also one that drives as fast as it may, interval by interval."""
    assume(speed_mps * speed_mps <= 2 * HARD_MPS2 * (ahead_m - 0.01))
    place_m = 400.0 - ahead_m
    heard = timings(spat(100.0, (RED, 0.0, 3000.0, 3000.0)))
    for _ in range(round(40 / interval_s)):
        top = ceiling(SIGNAL, on(place_m, speed_mps), heard, 100.0, interval_s, None).speed_mps
        after = min(top, speed_mps + 1.8 * interval_s)
        place_m += 0.5 * (speed_mps + after) * interval_s
        speed_mps = after
    assert 390.0 < place_m < 400.0
    assert speed_mps == 0.0


def test_a_green_line_is_passed_if_there_is_time() -> None:
    """Open ends bound nothing; a fixed one does where red comes before the vehicle."""
    free: Told = (GREEN, 90.0, 110.0, None)
    assert before_signal(36.0, 13.4, free).speed_mps == 13.4
    fixed: list[Told] = [(GREEN, 90.0, 101.0, 101.0), (YELLOW, 101.0, 104.0, 104.0)]
    red: Told = (RED, 104.0, 140.0, 140.0)
    soon: Told = (RED, 100.5, 140.0, 140.0)
    assert before_signal(37.0, 13.4, *fixed, red).speed_mps == 13.4
    assert before_signal(60.0, 13.4, *fixed, red).speed_mps == 13.4
    assert before_signal(60.0, 13.4, (GREEN, 90.0, 100.5, 100.5), soon).speed_mps == 13.4
    assert before_signal(37.0, 13.4, (GREEN, 90.0, 100.5, 100.5), soon).speed_mps < 13.0


def test_who_cannot_stop_goes_on_at_yellow_and_brakes_at_red() -> None:
    """At the hard rate, whatever is left of the way."""
    yellow: Told = (YELLOW, 99.0, 102.0, 102.0)
    assert before_signal(20.0, 13.4, yellow).speed_mps == 13.4
    ending: Told = (GREEN, 99.0, 100.2, 100.2)
    assert before_signal(20.0, 13.4, ending).speed_mps == 13.4
    red: Told = (RED, 99.0, 140.0, 140.0)
    assert before_signal(20.0, 13.4, red).speed_mps == pytest.approx(13.4 - 0.5 * HARD_MPS2)


def test_the_limit_is_that_of_the_place() -> None:
    """Of the segment, in a junction the turn's; behind the leg's end nothing is left to drive."""
    road = leg(segment("a", 100.0, onward=crossing(speed_mps=6.5)), segment("b", 500.0, 8.0))

    def top(place_m: float) -> float:
        return ceiling(road, on(place_m, 5.0, road), NOTHING, 0.0, 0.1, None).speed_mps

    assert [top(10.0), top(105.0), top(300.0)] == [13.4, 6.5, 8.0]
    assert top(620.5) == 0.0


def test_the_signal_of_the_own_lane_counts() -> None:
    """On the segment of the line; farther off the lane is not known yet."""
    road = leg(
        segment("a", 20.0),
        segment("b", 30.0, onward=crossing(groups=((0, 3), (1, 4)))),
        segment("c", 600.0),
    )
    heard = timings(spat(100.0, (RED, 0.0, 200.0, 200.0), group=4))

    def unknown(segment_id: str, number: int, lane: int) -> bool:
        state = VehicleState(segment_id, number, False, lane, 10.0, 10.0)
        return ceiling(road, state, heard, 100.0, 0.5, None).signal_unknown

    assert [unknown("b", 1, 0), unknown("b", 1, 1), unknown("a", 0, 1)] == [True, False, True]


def test_a_signal_that_tells_nothing_is_left_to_the_driver() -> None:
    """Where it is near; it bounds nothing, as one cannot tell whether it is green."""
    assert before_signal(50.0, 13.4) == Ceiling(13.4, True)
    assert before_signal(200.0, 13.4) == Ceiling(13.4, False)
    assert before_signal(50.0, 13.4, ("dark", 90.0, 200.0, None)) == Ceiling(13.4, True)
    stale = timings(spat(97.0, (RED, 0.0, 300.0, 300.0)))
    assert ceiling(SIGNAL, on(350.0, 13.4), stale, 100.0, 0.5, None) == Ceiling(13.4, True)


@given(
    speed_mps=SPEEDS,
    ahead_mps=SPEEDS,
    gap_m=st.floats(0, 200),
    interval_s=INTERVALS,
)
def test_the_gap_is_safe_if_the_vehicle_ahead_brakes_fully(
    speed_mps: float, ahead_mps: float, gap_m: float, interval_s: float
) -> None:
    """Half a second later it brakes as hard and stops behind it, if it could before."""
    road = leg(segment("a", 1e5, 60.0))
    ahead = SensedVehicle(track="x", vehicle=None, gap_m=gap_m, speed_mps=ahead_mps)
    state = VehicleState("a", 0, False, 0, 10.0, speed_mps)
    top = ceiling(road, state, NOTHING, 0.0, interval_s, ahead).speed_mps
    stopped_m = gap_m + ahead_mps * ahead_mps / (2 * FULL_MPS2)
    if stops_within_m(speed_mps, 0.0, RESPONSE_S, FULL_MPS2) <= stopped_m:
        assert stops_within_m(speed_mps, top, RESPONSE_S, FULL_MPS2) <= stopped_m + 1e-6
    else:
        assert top == 0.0


def test_a_gap_that_a_driver_keeps_is_not_touched() -> None:
    """The IDM's of the simulated vehicles: 2.5 m and 1.2 s."""
    road = leg(segment("a", 1e5, 30.0))
    for speed_mps in (5.0, 13.4, 30.0):
        gap_m = 2.5 + 1.2 * speed_mps
        ahead = SensedVehicle(track="x", vehicle=None, gap_m=gap_m, speed_mps=speed_mps)
        state = VehicleState("a", 0, False, 0, 10.0, speed_mps)
        assert ceiling(road, state, NOTHING, 0.0, 0.5, ahead).speed_mps >= speed_mps


def test_a_vehicle_on_its_braking_curve_brakes_on_along_it() -> None:
    """Neither harder nor softer than the rate."""
    ahead_m = (13.4**2 - 4.0**2) / (2 * HARD_MPS2)
    assert braked_after_mps(13.4, 4.0, ahead_m, HARD_MPS2, 0.5) == pytest.approx(12.15)
    assert braked_after_mps(math.inf, 4.0, math.inf, HARD_MPS2, 0.5) == 4.0

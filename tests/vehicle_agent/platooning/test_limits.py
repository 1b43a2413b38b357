"""Whatever messages and sensors say: no speed above the limit, nor one without a safe gap."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from slipstream.energy.consumption import PAPER_CAR, VehicleParameters
from slipstream.messages import (
    PlannedCrossing,
    PlannedSegment,
    PlatoonControl,
    PlatoonManagement,
    SensedVehicle,
    decode,
)
from tests.vehicle_agent.platooning.world import BEGIN_NS, Roadside, planned, sensing_of, told
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning import Platooning, PlatoonStep

NS = 1_000_000_000
BRAKING = 9.0

finite = st.floats(allow_nan=False, allow_infinity=False)
any_speed = st.one_of(st.floats(0, 60), st.floats(0, allow_nan=False, allow_infinity=False))
any_gap = st.one_of(st.floats(-10, 100), finite)
any_positive = st.one_of(
    st.floats(1.0, 3000.0), st.floats(0, exclude_min=True, allow_nan=False, allow_infinity=False)
)
names = st.sampled_from(["p", "q", "me", "x" * 200])
segments = st.sampled_from(["a", "b", "c", "z"])
counts = st.sampled_from([0, 1, 5, 2**63 - 1])


@st.composite
def times(draw: st.DrawFn, now_ns: int) -> int:
    """Around now, and at the ends of what a message may say."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.sampled_from([0, 2**63 - 1]))
    return max(0, now_ns + draw(st.integers(-2 * NS, NS // 2)))


@st.composite
def controls(draw: st.DrawFn, now_ns: int) -> PlatoonControl:
    """Any platoon control message."""
    return PlatoonControl(
        vehicle=draw(names),
        sequence=draw(counts),
        time_ns=draw(times(now_ns)),
        path=tuple(draw(st.lists(segments, min_size=1, max_size=4))),
        crossing=draw(st.booleans()),
        lane=draw(counts),
        front_m=draw(any_speed),
        length_m=draw(any_positive),
        speed_mps=draw(any_speed),
        acceleration_mps2=draw(finite),
        announced_mps=draw(any_speed),
        desired_mps=draw(any_speed),
        mode=draw(st.sampled_from(["alone", "following", "leaving"])),
        ahead=draw(st.none() | names),
        leader=draw(names),
        joined_by=draw(st.none() | names),
        tail_m=draw(any_speed),
        gap_m=draw(st.none() | finite),
        platoon=draw(st.none() | st.just("plan")),
        place=draw(st.none() | counts),
    )


@st.composite
def managements(draw: st.DrawFn, now_ns: int) -> PlatoonManagement:
    """Any platoon management message."""
    kind = draw(st.sampled_from(["join_request", "join_response", "leave"]))
    return PlatoonManagement(
        vehicle=draw(names),
        partner=draw(names),
        sequence=draw(counts),
        time_ns=draw(times(now_ns)),
        kind=kind,
        accepted=draw(st.booleans()) if kind == "join_response" else None,
        slowdown=draw(st.floats(0, 1)),
        reason=draw(st.none() | st.just("y" * 200)),
    )


@st.composite
def legs(draw: st.DrawFn) -> Leg:
    """Three segments of any length and limit, with any junctions."""
    parts = []
    for name in "abc":
        crossing = PlannedCrossing(
            length_m=draw(st.floats(0, 50)),
            speed_mps=draw(any_positive),
            yields=draw(st.booleans()),
        )
        parts.append(
            PlannedSegment(
                segment=name,
                entry_ns=0,
                exit_ns=0,
                speed_mps=draw(any_speed),
                platoon=draw(st.none() | st.just("plan")),
                place=draw(st.none() | counts),
                gap_m=draw(st.none() | any_positive),
                leg=0,
                length_m=draw(any_positive),
                speed_limit_mps=draw(any_positive),
                lanes=draw(st.none() | counts),
                crossing=draw(st.none() | st.just(crossing)),
            )
        )
    return Leg(1, 0, tuple(parts))


def following(interval_s: float, pace: float = 1.0) -> tuple[Platooning, Leg]:
    """A vehicle in a platoon behind `p`, one step before `BEGIN_NS`."""
    leg = Leg(1, 0, tuple(planned(name, 3000.0, 30.0) for name in "abc"))
    platooning = Platooning("me", PAPER_CAR, 4.6, interval_s, pace)
    now_ns = BEGIN_NS - round(interval_s * NS)
    platooning.receive(told(now_ns, 0, 209.1, 25.0, 25.0), now_ns)
    state = VehicleState("a", 0, False, 0, 200.0, 25.0)
    ahead = SensedVehicle(track="t", vehicle="p", gap_m=4.5, speed_mps=25.0)
    step = platooning.step(now_ns, leg, state, sensing_of(state, ahead, now_ns), Roadside())
    assert step.mode == "following"
    return platooning, leg


def check_bounds(step: PlatoonStep, limit_mps: float) -> None:
    """No command above the limit, negative or without a value, and no message that is none."""
    for speed in (step.speed_mps, step.cruise_mps):
        assert speed is None or 0.0 <= speed <= limit_mps
    assert (step.speed_mps is None) == (step.mode == "alone")
    assert math.isfinite(step.tail_m)
    assert step.gap_m is None or math.isfinite(step.gap_m)
    for message in (step.control, *step.messages):
        assert decode(type(message), message.to_bytes(), "k") == message


def least_gap_m(
    gap_m: float,
    own: tuple[float, float],
    front: tuple[float, float],
    interval_s: float,
    front_brakes_s: float,
) -> float:
    """Smallest gap if both end up braking with 9 m/s², by small steps.

    Args:
        gap_m: as sensed.
        own: speed now, and commanded for the end of the interval.
        front: speed as sensed, and at the moment when it begins to brake.
        front_brakes_s: that moment, from now.
        interval_s: of the command.
    """
    dt = 0.01
    t = np.arange(0.0, 12.0, dt)
    (v, c), (w, then) = own, front
    rear = np.minimum(v + (c - v) * t / interval_s, max(v, c))
    rear = np.where(t < interval_s, rear, np.maximum(0.0, c - BRAKING * (t - interval_s)))
    ahead = w + (then - w) * t / (front_brakes_s or 1.0)
    brakes = np.maximum(0.0, then - BRAKING * (t - front_brakes_s))
    ahead = np.where(t < front_brakes_s, ahead, brakes)
    moved = np.concatenate(([0.0], np.cumsum((ahead - rear)[1:] + (ahead - rear)[:-1]) * dt / 2))
    return float(gap_m + moved.min())


@pytest.mark.long
@given(data=st.data(), interval_s=st.sampled_from([0.1, 0.5]), pace=st.sampled_from([0.5, 1.0]))
@settings(max_examples=100, deadline=None)
def test_any_values_leave_commands_within_their_bounds(
    data: st.DataObject, interval_s: float, pace: float
) -> None:
    """Any messages, sensing, plan and clock, for six intervals, from a platoon on."""
    platooning, leg = following(interval_s, pace)
    now_ns = BEGIN_NS
    for _ in range(6):
        for message in data.draw(
            st.lists(st.one_of(controls(now_ns), managements(now_ns)), max_size=4)
        ):
            platooning.receive(message, now_ns)
        if data.draw(st.booleans()):
            leg = data.draw(legs())
        number = data.draw(st.integers(0, 2))
        state = VehicleState(
            leg.path[number],
            number,
            data.draw(st.booleans()),
            data.draw(counts),
            data.draw(any_speed),
            data.draw(any_speed),
            data.draw(finite),
        )
        ahead = None
        if data.draw(st.integers(0, 4)):
            ahead = SensedVehicle(
                track="t",
                vehicle=data.draw(st.none() | names),
                gap_m=data.draw(any_gap),
                speed_mps=data.draw(any_speed),
            )
        gates = Roadside(set(data.draw(st.lists(segments, max_size=2))))
        gates.turbulent = set(data.draw(st.lists(segments, max_size=1)))
        sensing = sensing_of(state, ahead, data.draw(times(now_ns)), data.draw(finite))
        cap = data.draw(st.none() | any_speed)
        step = platooning.step(now_ns, leg, state, sensing, gates, cap)
        check_bounds(step, leg.limits_mps[number])
        if data.draw(st.integers(0, 9)) == 0:
            for told_now in platooning.reset("z" * 300):
                assert told_now.kind == "leave"
        now_ns += data.draw(st.sampled_from([round(interval_s * NS), 0, 3 * NS, -NS]))


@pytest.mark.slow
@given(
    gap_m=st.floats(0.0, 80.0),
    speed=st.floats(0.0, 45.0),
    ahead_mps=st.floats(0.0, 45.0),
    announced=st.floats(0.0, 60.0),
    age_s=st.floats(0.0, 0.6),
    sensed_s=st.sampled_from([0.0, 0.0, 0.05, 0.2]),
    recognised=st.booleans(),
    limit=st.sampled_from([13.9, 30.0, 45.0]),
)
@settings(max_examples=400, deadline=None)
def test_the_vehicle_ahead_may_brake_as_hard_as_it_can(
    gap_m: float,
    speed: float,
    ahead_mps: float,
    announced: float,
    age_s: float,
    sensed_s: float,
    recognised: bool,
    limit: float,
) -> None:
    """Ten times a second: whatever it announced, it brakes with 9 m/s² from now on.

    Where the own sensing is late, both are taken to have driven on as they did, and as they told.
    After the interval this vehicle brakes as hard, and they do not touch; or it is told to brake
    with 9 m/s² already, which is all that is left.
    """
    platooning, _ = following(0.1)
    leg = Leg(1, 0, tuple(planned(name, 3000.0, limit) for name in "abc"))
    sent_ns = BEGIN_NS - round(age_s * NS)
    platooning.receive(told(sent_ns, 1, 204.6 + gap_m, ahead_mps, announced), BEGIN_NS)
    state = VehicleState("a", 0, False, 0, 200.0, speed)
    ahead = SensedVehicle(
        track="t", vehicle="p" if recognised else None, gap_m=gap_m, speed_mps=ahead_mps
    )
    sensing = sensing_of(state, ahead, BEGIN_NS - round(sensed_s * NS))
    step = platooning.step(BEGIN_NS, leg, state, sensing, Roadside())
    command = step.speed_mps
    assert command is not None
    check_bounds(step, limit)
    if command <= max(0.0, speed - BRAKING * 0.1) + 1e-9:
        return
    own, front = (speed, command), (ahead_mps, ahead_mps)
    now_m = gap_m + (ahead_mps - speed) * sensed_s
    assert least_gap_m(now_m, own, front, 0.1, 0.0) >= 0.0


@pytest.mark.slow
@given(
    gap_m=st.floats(0.0, 60.0),
    speed=st.floats(0.0, 40.0),
    ahead_mps=st.floats(0.0, 40.0),
    change=st.floats(-4.5, 1.5),
    silent=st.booleans(),
)
@settings(max_examples=400, deadline=None)
def test_an_announced_speed_is_driven_for_all_but_the_response_time_in_an_evaluation(
    gap_m: float, speed: float, ahead_mps: float, change: float, silent: bool
) -> None:
    """Twice a second: it drives towards what it announced, and brakes with 9 m/s² 0.1 s before.

    Where it announced nothing, it brakes from now on.
    """
    platooning, leg = following(0.5)
    announced = max(0.0, ahead_mps + change)
    if not silent:
        platooning.receive(told(BEGIN_NS, 1, 204.6 + gap_m, ahead_mps, announced), BEGIN_NS)
    state = VehicleState("a", 0, False, 0, 200.0, speed)
    ahead = SensedVehicle(
        track="t", vehicle=None if silent else "p", gap_m=gap_m, speed_mps=ahead_mps
    )
    step = platooning.step(BEGIN_NS, leg, state, sensing_of(state, ahead, BEGIN_NS), Roadside())
    command = step.speed_mps
    assert command is not None
    if command <= max(0.0, speed - BRAKING * 0.5) + 1e-9:
        return
    begins_s = 0.0 if silent else 0.4
    then = ahead_mps if silent else ahead_mps + 0.8 * (announced - ahead_mps)
    assert least_gap_m(gap_m, (speed, command), (ahead_mps, then), 0.5, begins_s) >= 0.0


@pytest.mark.slow
@given(speed=st.floats(0.0, 30.0), away_m=st.floats(0.001, 200.0), limit=st.floats(5.0, 20.0))
@settings(max_examples=100, deadline=None)
def test_a_lower_limit_ahead_is_kept_by_comfortable_braking(
    speed: float, away_m: float, limit: float
) -> None:
    """After the command, 2.5 m/s² is enough to pass its begin at that limit."""
    platooning, _ = following(0.1)
    leg = Leg(1, 0, (planned("a", 3000.0, 30.0), planned("b", 3000.0, limit)))
    state = VehicleState("a", 0, False, 0, 3000.0 - away_m, speed)
    ahead = SensedVehicle(track="t", vehicle="p", gap_m=50.0, speed_mps=30.0)
    step = platooning.step(BEGIN_NS, leg, state, sensing_of(state, ahead, BEGIN_NS), Roadside())
    command = step.speed_mps
    assert command is not None
    assume(command > speed - BRAKING * 0.1 + 1e-9)
    left_m = away_m - command * 0.1
    assert command**2 - 2 * 2.5 * left_m <= limit**2 + 1e-6


def test_a_heavy_vehicle_and_a_light_one_follow_alike() -> None:
    """Any physics that a file may give leaves a command within its bounds."""
    for mass_kg in (1e-3, 1e6):
        vehicle = VehicleParameters(mass_kg=mass_kg)
        platooning = Platooning("me", vehicle, 4.6, 0.1)
        _, leg = following(0.1)
        platooning.receive(told(BEGIN_NS, 1, 209.1, 25.0, 25.0), BEGIN_NS)
        state = VehicleState("a", 0, False, 0, 200.0, 25.0)
        ahead = SensedVehicle(track="t", vehicle="p", gap_m=4.5, speed_mps=25.0)
        sensing = sensing_of(state, ahead, BEGIN_NS)
        check_bounds(platooning.step(BEGIN_NS, leg, state, sensing, Roadside()), 30.0)

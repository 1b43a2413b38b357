"""Whatever messages and sensors say: no speed above the limit, and the braking that is needed."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from slipstream.braking import BRAKING, BrakingClass, Road
from slipstream.energy.consumption import VehicleParameters
from slipstream.messages import (
    PlannedCrossing,
    PlannedSegment,
    PlatoonControl,
    PlatoonManagement,
    SensedVehicle,
    decode,
)
from slipstream.spacing import closing_m
from tests.vehicle_agent.platooning.world import (
    BEGIN_NS,
    Roadside,
    planned,
    platooning_of,
    sensing_of,
    told,
)
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning import Platooning, PlatoonStep
from vehicle_agent.platooning.needed_braking import AIM_M, AheadMotion, needed_mps2

NS = 1_000_000_000
BRAKING_MPS2 = 9.0

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
        greatest_mps2=draw(any_positive),
        planned_mps2=tuple(draw(st.lists(finite, max_size=4))),
        limit_mps2=draw(st.none() | any_positive),
        needs_mps2=draw(st.none() | any_positive),
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
    platooning = platooning_of(interval_s, pace=pace)
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


@given(
    braking=st.sampled_from(list(BRAKING)),
    road=st.sampled_from(["dry", "wet", "snow"]),
    share=st.floats(0.05, 1.0),
    front=st.floats(0.0, 40.0),
    faster=st.floats(-5.0, 5.0),
    more_m=st.floats(0.0, 50.0),
)
@settings(max_examples=300, deadline=None)
def test_where_the_gap_is_large_enough_the_guaranteed_braking_is_all_that_is_needed(
    braking: BrakingClass, road: Road, share: float, front: float, faster: float, more_m: float
) -> None:
    """The law of the gap and the needed braking agree: whatever the vehicle ahead brakes with, and
    both speeds, for as long as the own brake takes.
    """
    own = BRAKING[braking].on(road)
    front_mps2, speed = share * own.greatest_mps2, max(0.0, front + faster)
    closing = closing_m(front, speed, front_mps2, own.guaranteed_mps2, own.response_s)
    ahead = AheadMotion(AIM_M + closing + more_m, front, slowing_mps2=front_mps2)
    needed = needed_mps2(ahead, speed, speed, own.response_s)
    assert needed <= own.guaranteed_mps2 * (1 + 1e-6)


@pytest.mark.slow
@given(
    gap_m=st.floats(0.0, 80.0),
    speed=st.floats(0.0, 45.0),
    ahead_mps=st.floats(0.0, 45.0),
    told_mps2=st.floats(-9.0, 3.0),
    recognised=st.booleans(),
)
@settings(max_examples=200, deadline=None)
def test_who_is_told_of_braking_brakes_as_much_as_it_needs(
    gap_m: float,
    speed: float,
    ahead_mps: float,
    told_mps2: float,
    recognised: bool,
) -> None:
    """Driven on with the command as it is, it does not touch a partner that brakes as it tells; or
    it is told to brake as hard as it can, which is all that is left.
    """
    platooning, leg = following(0.1)
    announced = max(0.0, ahead_mps + 0.1 * told_mps2)
    message = told(BEGIN_NS, 1, 204.6 + gap_m, ahead_mps, announced)
    message = message.model_copy(update={"planned_mps2": (told_mps2,)})
    platooning.receive(message, BEGIN_NS)
    state = VehicleState("a", 0, False, 0, 200.0, speed)
    ahead = SensedVehicle(
        track="t", vehicle="p" if recognised else None, gap_m=gap_m, speed_mps=ahead_mps
    )
    sensing = sensing_of(state, ahead, BEGIN_NS)
    step = platooning.step(BEGIN_NS, leg, state, sensing, Roadside())
    command = step.speed_mps
    assert command is not None
    check_bounds(step, 30.0)
    if not recognised or told_mps2 >= 0 or command <= max(0.0, speed - BRAKING_MPS2 * 0.1) + 1e-9:
        return
    braking = (speed - command) / 0.1
    if braking > 0 and gap_m > 2 * AIM_M:
        assert gap_m > closing_m(ahead_mps, speed, -told_mps2, braking, 0.0)


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
    assume(command > speed - BRAKING_MPS2 * 0.1 + 1e-9)
    left_m = away_m - command * 0.1
    assert command**2 - 2 * 2.5 * left_m <= limit**2 + 1e-6


def test_a_heavy_vehicle_and_a_light_one_follow_alike() -> None:
    """Any physics that a file may give leaves a command within its bounds."""
    for mass_kg in (1e-3, 1e6):
        vehicle = VehicleParameters(mass_kg=mass_kg)
        platooning = platooning_of(0.1, vehicle=vehicle)
        _, leg = following(0.1)
        platooning.receive(told(BEGIN_NS, 1, 209.1, 25.0, 25.0), BEGIN_NS)
        state = VehicleState("a", 0, False, 0, 200.0, 25.0)
        ahead = SensedVehicle(track="t", vehicle="p", gap_m=4.5, speed_mps=25.0)
        sensing = sensing_of(state, ahead, BEGIN_NS)
        check_bounds(platooning.step(BEGIN_NS, leg, state, sensing, Roadside()), 30.0)

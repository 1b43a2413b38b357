"""The agent as a whole: advice, what it sends, and what ends close gaps."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slipstream.braking import BRAKING
from slipstream.messages import (
    DrivingAdvice,
    Estimate,
    KinematicFeatures,
    PlanAcknowledgement,
    PlatoonControl,
    PlatoonManagement,
    SensedVehicle,
    SignalPhaseAndTiming,
    SignalRequest,
    VehicleAdvice,
    VehiclePosition,
    VehicleProgress,
    spat_key,
)
from tests.vehicle_agent.road import course, crossing, ns, segment, spat, state
from tests.vehicle_agent.tours import VAN, ahead, continued, plan, report, sensing
from vehicle_agent.agent import Agent, AgentParameters
from vehicle_agent.host import AgentHost

LIMIT_MPS = 13.4
ROUGH = KinematicFeatures(
    mean_speed_mps=Estimate(value=8.0),
    mean_acceleration_mps2=Estimate(value=0.0),
    density_veh_per_m=Estimate(value=0.05),
    speed_std_mps=Estimate(value=4.0),
    acceleration_variance_m2ps4=Estimate(value=2.0),
)


def agent(**fields: Any) -> Agent:
    """One that follows `plan`."""
    found = Agent(VAN)
    found.receive(plan(**fields), ns(1))
    found.take_outgoing()
    return found


def sent(one: Agent, kind: type[Any]) -> list[Any]:
    """Messages of a kind, since they were taken last."""
    return [message for _, message in one.take_outgoing() if isinstance(message, kind)]


def partner(
    time_s: float, front_m: float, name: str = "front", path: tuple[str, ...] = ("out1", "out2")
) -> PlatoonControl:
    """A vehicle of the fleet ahead, as it tells of itself."""
    return PlatoonControl(
        vehicle=name,
        sequence=round(time_s * 10),
        time_ns=ns(time_s),
        path=path,
        crossing=False,
        lane=0,
        front_m=front_m,
        length_m=4.6,
        speed_mps=10.0,
        acceleration_mps2=0.0,
        announced_mps=10.0,
        desired_mps=LIMIT_MPS,
        mode="alone",
        ahead=None,
        leader=name,
        joined_by=None,
        tail_m=0.0,
        limit_mps2=2.0,
    )


def test_a_plan_is_answered_and_progress_told() -> None:
    """At once; a plan that does not fit is answered too, with the reason."""
    one = Agent(VAN)
    one.receive(plan(), ns(1))
    (answer,) = sent(one, PlanAcknowledgement)
    assert (answer.accepted, answer.cycle) == (True, 1)
    one.receive(plan(2, valid_until_ns=ns(1)), ns(2))
    (answer,) = sent(one, PlanAcknowledgement)
    assert not answer.accepted
    one.receive(report(3, "refused", None, "flat tyre"), ns(3))
    kinds = [type(message) for _, message in one.take_outgoing()]
    assert kinds == [PlanAcknowledgement, VehicleProgress]


def test_a_vehicle_that_stands_is_told_when_to_leave() -> None:
    """By its plan from the depot; after a stop as soon as that is served."""
    one = agent()
    advice = one.advise(sensing(10, on_road=False), ns(10))
    assert (advice.mode, advice.depart_ns) == ("none", ns(60))
    assert "50 s" in advice.text
    one.advise(sensing(70, "out1", 5.0), ns(70))
    one.advise(sensing(110, "out2", 5.0), ns(110))
    advice = one.advise(sensing(120, "out2", on_road=False), ns(120))
    assert (advice.depart_ns, advice.text) == (None, "Serve a.")
    one.receive(report(180, "served", "a"), ns(180))
    advice = one.advise(sensing(181, "out2", on_road=False), ns(181))
    assert advice.depart_ns is not None
    assert advice.depart_ns <= ns(181)


def test_positions_each_second_and_progress_at_changes() -> None:
    """A vehicle that drives tells where it is by segment and share."""
    one = agent()
    told: list[Any] = []
    for tick in range(50):
        at_s = 70 + tick / 10
        one.advise(sensing(at_s, "out1", 10.0 + tick), ns(at_s))
        told += [message for _, message in one.take_outgoing()]
    positions = [m for m in told if isinstance(m, VehiclePosition)]
    assert len(positions) == 5
    assert positions[-1].share == pytest.approx((10 + 40) / 300, abs=0.01)
    assert {p.cycle for p in positions} == {1}
    assert len([m for m in told if isinstance(m, VehicleProgress)]) == 1
    assert len([m for m in told if isinstance(m, PlatoonControl)]) == 50


def test_without_a_plan_there_is_no_advice() -> None:
    """Off the way neither; the reason is said."""
    one = Agent(VAN)
    assert one.advise(sensing(1, on_road=False), ns(1)).reason == "no plan"
    one = agent()
    one.advise(sensing(70, "out1"), ns(70))
    advice = one.advise(sensing(71, "elsewhere"), ns(71))
    assert (advice.mode, advice.reason) == ("none", "off the planned way")


def eco(**fields: Any) -> Any:
    """A plan through a signal, with speed advice."""
    way = (
        segment("a", 400.0, onward=crossing(groups=((0, 3),))),
        segment("b", 600.0),
    )
    whole = plan()
    return whole.model_copy(
        update={
            "segments": way,
            "stops": (whole.stops[0], whole.stops[3]),
            "advice": DrivingAdvice(eco_approach=True, coasting_budget=0.06, **fields),
        }
    )


@pytest.mark.parametrize("interval_s", [0.1, 0.5])
def test_a_speed_is_advised_ahead_of_what_the_vehicle_takes_to_come_to_it(
    interval_s: float,
) -> None:
    """Its speed loop takes twice its response: as told, it slows down as one without any does, and
    speeds up no sooner.
    """
    told = {}
    for name in ("ideal", "car"):
        own = AgentParameters(braking=BRAKING[name].on("dry"), interval_s=interval_s)
        for speed_mps in (13.0, 6.0):
            one = Agent(VAN, own)
            one.receive(eco(), ns(1))
            one.receive(spat(70.0, *course((90.0, 120.0))), ns(70))
            advice = one.advise(sensing(70, "a", 250.0, speed_mps=speed_mps), ns(70))
            assert advice.mode == "speed"
            assert advice.speed_mps is not None
            told[name, speed_mps] = advice.speed_mps
    slowing_mps2 = (13.0 - told["ideal", 13.0]) / interval_s
    assert 0.1 < slowing_mps2 < 2.5
    car = BRAKING["car"].on("dry")
    loop_s = 2 * car.nominal_s + car.lag_s
    assert (13.0 - told["car", 13.0]) / loop_s == pytest.approx(slowing_mps2)
    assert told["car", 6.0] == told["ideal", 6.0] >= 6.0


def test_speed_towards_a_red_light_and_a_request_for_green() -> None:
    """Both where the plan allows them; the request is taken back at the stop."""
    one = Agent(VAN)
    one.receive(eco(signal_priority=True), ns(1))
    one.take_outgoing()
    one.receive(spat(70.0, *course((90.0, 120.0))), ns(70))
    advice = one.advise(sensing(70, "a", 250.0, speed_mps=13.0), ns(70))
    assert advice.mode == "speed"
    assert advice.speed_mps is not None
    assert advice.speed_mps < 13.0
    assert advice.green_at == "signal"
    (request,) = sent(one, SignalRequest)
    assert (request.kind, request.signal_group) == ("priorityRequest", 3)
    one.advise(sensing(72, "b", on_road=False), ns(72))
    (request,) = sent(one, SignalRequest)
    assert request.kind == "priorityCancellation"


def test_it_listens_to_the_road_ahead_only() -> None:
    """States and signals of segments that lie behind are dropped."""
    one = Agent(VAN)
    one.receive(eco(), ns(1))
    assert spat_key("signal") in one.topics()
    one.advise(sensing(70, "a", 10.0), ns(70))
    assert any("/segment/a/" in key for key in one.topics())
    one.advise(sensing(99, "b", 10.0), ns(99))
    assert not any("/segment/a/" in key for key in one.topics())
    assert spat_key("signal") not in one.topics()


def joined(at_s: float = 70.0) -> Agent:
    """An agent that follows `front` on a stable segment."""
    one = agent()
    mode = ""
    for tick in range(60):
        now_s = at_s + tick / 10
        for name in ("out1", "out2", "on1", "home1", "home2"):
            one.receive(state(name, now_s), ns(now_s))
        front_m = 50.0 + tick
        one.receive(partner(now_s, front_m), ns(now_s))
        seen = ahead(8.0, 10.0, "front")
        advice = one.advise(sensing(now_s, "out1", front_m - 12.6, ahead=seen), ns(now_s))
        mode = advice.mode
    assert mode == "follow"
    one.take_outgoing()
    return one


LAST_S = 70.0 + 5.9

Silence = Callable[[Agent], VehicleAdvice]


def advised(
    one: Agent, after_s: float, *, stable: bool = True, heard: bool = True, **fields: Any
) -> VehicleAdvice:
    """The advice some time after the last message of `joined`."""
    now_s = LAST_S + after_s
    if stable:
        one.receive(state("out1", now_s), ns(now_s))
        one.receive(state("out2", now_s), ns(now_s))
    if heard:
        one.receive(partner(now_s, 110.0), ns(now_s))
    told = {"ahead": ahead(2.5, 10.0, "front"), "time_ns": ns(now_s)} | fields
    return one.advise(sensing(now_s, "out1", 100.0, **told), ns(now_s))


@pytest.mark.parametrize(
    ("why", "change"),
    [
        ("partner silent for 0.5 s", lambda one: advised(one, 0.6, heard=False)),
        ("stale state", lambda one: advised(one, 5.2, stable=False)),
        ("clock", lambda one: advised(one, 0.1, clock_error_s=0.2)),
        ("old sensing", lambda one: advised(one, 0.1, time_ns=ns(LAST_S - 1))),
        ("cut-in", lambda one: advised(one, 0.1, ahead=ahead(2.5, 10.0))),
    ],
)
def test_close_gaps_end_at_once(why: str, change: Silence) -> None:
    """One control interval later the gap is being opened."""
    one = joined()
    assert advised(one, 0.05).mode == "follow"
    advice = change(one)
    assert advice.mode in ("open_gap", "none"), why
    assert advice.reason, why


def test_a_turbulent_flag_ends_a_close_gap() -> None:
    """Whatever the partner does."""
    one = joined()
    rough = msgspec.structs.replace(state("out1", LAST_S + 0.1), features=ROUGH, y_e=0)
    one.receive(rough, ns(LAST_S + 0.1))
    advice = advised(one, 0.1, stable=False)
    assert advice.mode == "open_gap"
    assert "turbulent" in (advice.reason or "")


def test_a_superseded_plan_that_cannot_be_replaced_ends_a_close_gap() -> None:
    """The way stays until there is another one."""
    one = joined()
    one.receive(plan(2), ns(LAST_S))
    answer, *_ = sent(one, PlanAcknowledgement)
    assert not answer.accepted
    advice = advised(one, 0.1)
    assert advice.mode == "open_gap"
    assert one.tour.plan is not None
    one = joined()
    one.receive(continued(2, 1, 0), ns(LAST_S))
    assert advised(one, 0.1).mode == "follow"


def test_a_lapsed_plan_ends_a_close_gap() -> None:
    """The way to the next stop stays."""
    one = joined()
    advice = advised(one, 10_000.0)
    assert advice.mode == "open_gap"
    assert one.tour.plan is not None


def test_brakes_that_do_less_than_declared_end_a_close_gap() -> None:
    """Its driver and its dispatcher are told by how much."""
    one = joined()
    brakes = one._platooning._brakes
    brakes.share, brakes.braking = 0.62, BRAKING["truck"].on("snow")
    advice = advised(one, 1.0)
    assert advice.mode == "open_gap"
    assert advice.reason == "it brakes with 62% of what is declared"
    (position,) = sent(one, VehiclePosition)
    assert position.braking_share == 0.62


def test_what_an_agent_sends_to_partners_reaches_them_in_one_process() -> None:
    """And nobody else."""
    host = AgentHost({name: AgentParameters() for name in (VAN, "front")})
    whole = plan()
    for name in (VAN, "front"):
        host.receive(whole.model_copy(update={"vehicle": name}), ns(1))
    host.advise(sensing(70, "out1", 100.0, vehicle="front"), ns(70))
    host.advise(sensing(70, "out1", 50.0), ns(70))
    _, out = host.advise(sensing(70.1, "out1", 100.0, vehicle="front"), ns(70.1))
    for _, message in out:
        host.receive(message, ns(70.1))
    assert any("platoon/out1" in key for key in host.topics())
    assert not [
        message
        for _, message in host.agents[VAN].take_outgoing()
        if isinstance(message, PlatoonManagement)
    ]


numbers = st.floats(0, 1e6, allow_nan=False)
speeds = st.floats(0, 80, allow_nan=False)
near = st.one_of(st.none(), st.sampled_from(["front", "other"]))


@pytest.mark.slow
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    front_m=st.floats(0, 399),
    speed_mps=speeds,
    gap_m=st.floats(-5, 200),
    front_mps=speeds,
    vehicle=near,
    red_s=st.floats(60, 200),
    told=st.booleans(),
    clock_error_s=st.floats(0, 10),
)
def test_advice_never_breaks_a_limit(
    front_m: float,
    speed_mps: float,
    gap_m: float,
    front_mps: float,
    vehicle: str | None,
    red_s: float,
    told: bool,
    clock_error_s: float,
) -> None:
    """Not above the limit, and not past a stop line at red where the vehicle could stop."""
    one = Agent(VAN)
    one.receive(eco(), ns(1))
    if told:
        one.receive(spat(70.0, *course((red_s, red_s + 20))), ns(70))
    one.receive(state("a", 70.0), ns(70))
    one.receive(partner(70.0, min(399.0, front_m + max(0.0, gap_m) + 4.6), path=("a", "b")), ns(70))
    seen = SensedVehicle(track="t", vehicle=vehicle, gap_m=gap_m, speed_mps=front_mps)
    own = sensing(70, "a", front_m, speed_mps=speed_mps, ahead=seen, clock_error_s=clock_error_s)
    advice = one.advise(own, ns(70))
    if advice.speed_mps is None:
        assert advice.mode == "none"
        return
    # From above the limit it brakes, no harder than the hard rate asks for.
    assert advice.speed_mps <= max(LIMIT_MPS, speed_mps)
    assert advice.speed_mps <= LIMIT_MPS + 1e-9 or advice.mode in ("speed", "open_gap", "follow")
    line_m = 400.0 - front_m
    red = told and red_s > 70.0
    if red and speed_mps**2 / 5.0 <= line_m and advice.mode in ("speed", "follow", "cruise"):
        after_m = line_m - 0.1 * 0.5 * (speed_mps + advice.speed_mps)
        assert advice.speed_mps**2 / 5.0 <= after_m + 0.05


def test_an_advice_takes_less_than_two_milliseconds() -> None:
    """In the mean, with a partner near; the mark is 2 ms."""
    one = joined()
    count = 200
    began = time.process_time()
    for tick in range(count):
        advised(one, 0.1 + tick * 1e-3)
    assert (time.process_time() - began) / count < 0.002


def test_messages_of_others_are_left_out() -> None:
    """A plan for another vehicle is not answered; an unknown message changes nothing."""
    one = Agent(VAN)
    one.receive(plan().model_copy(update={"vehicle": "other"}), ns(1))
    one.receive(SignalPhaseAndTiming(intersection="x", revision=0, time_ns=0, movements=()), ns(1))
    assert one.take_outgoing() == []

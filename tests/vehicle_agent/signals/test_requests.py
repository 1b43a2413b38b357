"""Whom a vehicle asks for green, for when, and that it takes back what it needs no more."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from slipstream.messages import PhaseState, SignalRequest
from tests.vehicle_agent.road import crossing, leg, segment, spat, timings
from vehicle_agent.leg import VehicleState
from vehicle_agent.signals import SignalRequests

ROAD = leg(
    segment("a", 200.0, onward=crossing(groups=((0, 3), (1, 4)), intersection="one")),
    segment("b", 60.0, onward=crossing(groups=((0, 5),), intersection="two")),
    segment("c", 300.0),
)
OTHER = leg(
    segment("a", 200.0, onward=crossing(groups=((0, 6),), intersection="one")),
    segment("d", 300.0),
)


def at(front_m: float, lane: int = 0, speed_mps: float = 13.4) -> VehicleState:
    """On the first segment."""
    return VehicleState("a", 0, False, lane, front_m, speed_mps)


def brief(messages: tuple[SignalRequest, ...]) -> list[tuple[str, int, str, int]]:
    """What matters of requests."""
    return [(m.intersection, m.request, m.kind, m.signal_group) for m in messages]


def test_a_vehicle_asks_once_it_is_near_and_then_once_a_second() -> None:
    """Twelve seconds before the line; the number stays, the sequence goes on."""
    asking = SignalRequests("van", timings())
    assert asking.step(100.0, ROAD, at(30.0)) == ()
    first = asking.step(101.0, ROAD, at(66.0))
    assert brief(first) == [("one", 1, "priorityRequest", 3)]
    assert first[0].arrival_ns == 111_000_000_000
    assert first[0].through_ns == 112_500_000_000
    assert asking.step(101.5, ROAD, at(70.0)) == ()
    second = asking.step(102.0, ROAD, at(79.4, lane=1), tail_m=40.0)
    assert brief(second) == [("one", 1, "priorityRequestUpdate", 4)]
    assert second[0].sequence == first[0].sequence + 1
    assert second[0].through_ns - second[0].arrival_ns == 6_500_000_000


def test_it_asks_beyond_a_signal_only_where_that_is_green() -> None:
    """Who must stop at the first signal does not know when it is at the second."""

    def asked(state: PhaseState) -> list[str]:
        told = timings(spat(0.0, (state, 0.0, 30.0, 30.0)))
        told.receive(spat(0.0, (state, 0.0, 30.0, 30.0), intersection="one"))
        sent = SignalRequests("van", told).step(1.0, ROAD, at(150.0))
        return [message.intersection for message in sent]

    assert asked("protected-Movement-Allowed") == ["one", "two"]
    assert asked("stop-And-Remain") == ["one"]
    assert asked("protected-clearance") == ["one"]
    assert [m.intersection for m in SignalRequests("v", timings()).step(1.0, ROAD, at(150.0))] == [
        "one"
    ]


def test_what_is_passed_or_left_is_taken_back() -> None:
    """Behind the line, at the end, and on a way that leads elsewhere; the same line stays asked."""
    asking = SignalRequests("van", timings())
    asking.step(0.0, ROAD, at(150.0))
    passed = asking.step(5.0, ROAD, VehicleState("b", 1, False, 0, 10.0, 13.4))
    assert brief(passed) == [
        ("one", 1, "priorityCancellation", 3),
        ("two", 2, "priorityRequest", 5),
    ]
    assert brief(asking.step(6.0, OTHER, at(150.0))) == [
        ("two", 2, "priorityCancellation", 5),
        ("one", 3, "priorityRequest", 6),
    ]
    assert brief(asking.step(7.0, ROAD, at(160.0))) == [("one", 3, "priorityRequestUpdate", 3)]
    assert brief(asking.end(7.2)) == [("one", 3, "priorityCancellation", 3)]
    assert asking.end(7.3) == ()
    assert brief(asking.step(7.4, ROAD, at(160.0))) == [("one", 4, "priorityRequest", 3)]


FINITE = st.floats(0, allow_nan=False, allow_infinity=False)


@given(front_m=FINITE, speed_mps=FINITE, tail_m=st.floats(0, 1e6), lane=st.integers(0, 2**62))
def test_any_state_gives_valid_requests(
    front_m: float, speed_mps: float, tail_m: float, lane: int
) -> None:
    """Times are in order, whatever the vehicle's message says."""
    state = replace(at(front_m, speed_mps=speed_mps), lane=lane)
    for message in SignalRequests("van", timings()).step(50.0, ROAD, state, tail_m):
        assert 50_000_000_000 <= message.arrival_ns <= message.through_ns

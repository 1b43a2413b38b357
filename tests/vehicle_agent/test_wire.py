"""What an agent takes for the message of its key."""

from __future__ import annotations

import pytest

from slipstream.errors import InputError
from slipstream.messages import (
    Message,
    PlatoonControl,
    PlatoonManagement,
    SegmentState,
    SignalPhaseAndTiming,
    SignalStatus,
    driver_key,
    plan_key,
    platoon_control_key,
    platoon_management_key,
    sensing_key,
    signal_status_key,
    spat_key,
    state_key,
)
from tests.vehicle_agent.tours import VAN, plan, report, sensing
from vehicle_agent.wire import message_of

CONTROL = PlatoonControl(
    vehicle="front",
    sequence=1,
    time_ns=1,
    path=("out1", "out2"),
    crossing=False,
    lane=0,
    front_m=0.0,
    length_m=4.6,
    speed_mps=10.0,
    acceleration_mps2=0.0,
    announced_mps=10.0,
    desired_mps=10.0,
    mode="alone",
    ahead=None,
    leader="front",
    joined_by=None,
    tail_m=0.0,
)
LEAVE = PlatoonManagement(
    vehicle="front", partner=VAN, sequence=1, time_ns=1, kind="leave", accepted=None
)
STATE = SegmentState(
    rsu="rsu-1",
    segment="out1",
    sequence=1,
    time_ns=1,
    window_s=10.0,
    features=None,
    y_e=None,
    reason="stale",
    vehicles=0,
    frames=0,
    coverage=0.0,
)
SPAT = SignalPhaseAndTiming(intersection="x", revision=0, time_ns=0, movements=())
STATUS = SignalStatus(intersection="x", sequence=0, time_ns=0, requests=())


@pytest.mark.attack
@pytest.mark.parametrize(
    ("message", "own", "others"),
    [
        (sensing(1), sensing_key(VAN), [sensing_key("other")]),
        (report(1, "refused", None, "flat tyre"), driver_key(VAN), [driver_key("other")]),
        (plan(), plan_key(VAN), [plan_key("other")]),
        (
            CONTROL,
            platoon_control_key("out1", "front"),
            [platoon_control_key("out1", "other"), platoon_control_key("out2", "front")],
        ),
        (
            LEAVE,
            platoon_management_key(VAN, "front"),
            [platoon_management_key(VAN, "other"), platoon_management_key("other", "front")],
        ),
        (STATE, state_key("rsu-1", "out1"), [state_key("other", "out1"), state_key("rsu-1", "x")]),
        (SPAT, spat_key("x"), [spat_key("other")]),
        (STATUS, signal_status_key("x"), [signal_status_key("other")]),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Message) else "",
)
def test_a_message_is_of_the_sender_of_its_key(
    message: Message, own: str, others: list[str]
) -> None:
    """Routers decide by the key who may send: a name within that is another's is refused."""
    assert message_of(own, message.to_bytes()) == message
    for key in others:
        with pytest.raises(InputError, match="not the sender"):
            message_of(key, message.to_bytes())


@pytest.mark.parametrize(
    "key", ["slipstream/v1/fleet/x/else", "elsewhere", "slipstream/v1/vehicle"]
)
def test_an_unknown_key_is_refused(key: str) -> None:
    """It promises nothing."""
    with pytest.raises(InputError, match="not a key"):
        message_of(key, b"{}")

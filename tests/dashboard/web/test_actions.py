"""What an operator asks for, as calls of the dispatcher's API."""

from __future__ import annotations

import pytest

from dashboard.web.routes.actions import Action, ActionCall, call_of, told
from slipstream.config import check
from slipstream.errors import InputError

CALLS = {
    "pause dispatcher": ActionCall("POST", "/v1/control/pause"),
    "resume dispatcher": ActionCall("POST", "/v1/control/resume"),
    "solve dispatcher": ActionCall("POST", "/v1/control/cycle"),
    "pin order/o-17": ActionCall("POST", "/v1/orders/o-17/pin"),
    "release order/a/b ?c": ActionCall("POST", "/v1/orders/a%2Fb%20%3Fc/release"),
    "cancel order/../x": ActionCall("DELETE", "/v1/orders/..%2Fx"),
    "acknowledge alarm/rsu-1:silent": ActionCall("POST", "/v1/alarms/rsu-1%3Asilent/acknowledge"),
}


@pytest.mark.parametrize("asked", CALLS)
def test_each_action_is_one_call(asked: str) -> None:
    """Names are one part of the path, whatever they hold."""
    kind, _, subject = asked.partition(" ")
    action = check({"action": kind, "subject": subject}, Action, "request")
    assert call_of(action) == CALLS[asked]
    assert told(action)


@pytest.mark.parametrize("asked", CALLS)
def test_the_reason_goes_to_the_dispatcher(asked: str) -> None:
    """With each action."""
    kind, _, subject = asked.partition(" ")
    action = Action.model_validate({"action": kind, "subject": subject, "reason": "customer rang"})
    assert call_of(action).body == {"reason": "customer rang"}


def test_an_order_is_pinned_to_a_vehicle() -> None:
    """If one is named."""
    action = Action(action="pin", subject="order/o-1", vehicle="van-2")
    assert call_of(action) == ActionCall("POST", "/v1/orders/o-1/pin", {"vehicle": "van-2"})
    assert "van-2" in told(action)


@pytest.mark.parametrize(
    "data",
    [
        {"action": "pause", "subject": "order/o-1"},
        {"action": "pin", "subject": "dispatcher"},
        {"action": "pin", "subject": "order/"},
        {"action": "cancel", "subject": "alarm/a"},
        {"action": "acknowledge", "subject": "order/o"},
        {"action": "cancel", "subject": "order/o", "vehicle": "van-1"},
        {"action": "reboot", "subject": "dispatcher"},
        {"action": "pause"},
        {"action": "pause", "subject": "dispatcher", "url": "http://elsewhere"},
        [],
    ],
    ids=str,
)
def test_what_makes_no_sense_is_refused(data: object) -> None:
    """With one line."""
    with pytest.raises(InputError):
        check(data, Action, "request")

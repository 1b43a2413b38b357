"""Orders over the bus: what HTTP answers, asked with a payload."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.intake import OrderAnswers
from slipstream.bus import Bus, Router
from slipstream.config import BusSettings
from slipstream.messages import (
    ALL_ORDERS,
    OrderHistory,
    OrderReceipt,
    OrderRefusal,
    OrderRequest,
    decode,
    order_key,
)
from storage import open_reader

from .desk import opened


def ask(bus: Bus, key: str, question: object = None) -> tuple[bool, bytes]:
    """The answer, as soon as the dispatcher is there."""
    payload = b"" if question is None else json.dumps(question).encode()
    ends = time.monotonic() + 20.0
    while time.monotonic() < ends:
        found = bus.ask(key, payload, 10.0)
        if found is not None:
            return found
    raise AssertionError(f"no answer on {key}")


def refusal(answer: tuple[bool, bytes]) -> OrderRefusal:
    """Of an answer that is one."""
    assert not answer[0]
    return decode(OrderRefusal, answer[1], "answer")


@pytest.mark.long
@pytest.mark.process
def test_an_order_is_submitted_shown_and_cancelled_over_the_bus(
    district: RoutingProblem, tmp_path: Path
) -> None:
    """With the receipt, the life and the refusals of the API."""
    name = "a/b"
    with Router() as router, opened(district, tmp_path) as desk:
        settings = BusSettings(connect=(router.endpoint,))
        with Bus.open(settings) as dispatcher, Bus.open(settings) as caller:
            dispatcher.answer(ALL_ORDERS, OrderAnswers(desk.intake).answer)
            asked = {"id": name, "node": "11", "latest": "2099-01-01T00:00:00Z"}
            first = ask(caller, order_key(name, "submit"), asked)
            assert first[0]
            receipt = decode(OrderReceipt, first[1], "answer")
            assert receipt == desk.intake.submit([desk.intake.show(name).request])[0][0]  # type: ignore[list-item]
            assert ask(caller, order_key(name, "submit"), asked) == first
            known = refusal(ask(caller, order_key(name, "submit"), {**asked, "demand": 1}))
            assert (known.kind, known.key) == ("conflict", "id")
            assert ask(caller, order_key(name, "pin"), {"vehicle": "van-1"})[0]
            why = {"reason": "its driver asked"}
            assert ask(caller, order_key(name, "release"), why)[0]
            shown = decode(OrderHistory, ask(caller, order_key(name, "show"))[1], "answer")
            assert [step.reason for step in shown.history] == [
                "submitted",
                "pinned to van-1",
                "released from van-1: its driver asked",
            ]
            assert ask(caller, order_key(name, "cancel"))[0]
            assert desk.state(name) == "cancelled"
            assert refusal(ask(caller, order_key("x", "submit"), asked)).key == "id"
            assert refusal(ask(caller, order_key("x", "show"))).kind == "not_found"
            assert refusal(ask(caller, order_key("x", "sell"))).problem == "unknown action 'sell'"
            (is_answer, text) = ask(caller, "slipstream/v1/order/*/cancel")
            assert not is_answer
            assert b"a pattern of keys" in text


def test_an_order_is_taken_as_the_message_that_it_is(
    district: RoutingProblem, tmp_path: Path
) -> None:
    """A field that is not known may be a constraint, and is refused."""
    request = OrderRequest(id="x", node="11", latest=4_070_908_800 * 10**9)
    fields = json.loads(request.to_bytes())
    with opened(district, tmp_path) as desk:
        answers, key = OrderAnswers(desk.intake), order_key("x", "submit")
        answer = refusal(answers.answer(key, json.dumps(fields | {"frozen": True}).encode()))
        assert (answer.kind, answer.key) == ("invalid", "frozen")
        assert answers.answer(key, request.to_bytes())[0]
        assert desk.intake.show("x").request == request


@pytest.mark.slow
@pytest.mark.parametrize("field", ["id", "node", "\ud800"])
def test_text_that_cannot_be_encoded_is_refused(
    district: RoutingProblem, tmp_path: Path, field: str
) -> None:
    """Half a surrogate pair in a value or a key."""
    with opened(district, tmp_path) as desk:
        payload = json.dumps({"id": "o", "node": "11", field: "\ud800"}).encode()
        found = refusal(OrderAnswers(desk.intake).answer(order_key("o", "submit"), payload))
        assert found.kind == "invalid"


def test_what_is_done_over_the_bus_is_logged(district: RoutingProblem, tmp_path: Path) -> None:
    """As over HTTP: pin, release and cancel, and nothing that was refused or only asked."""
    with opened(district, tmp_path) as desk:
        answers = OrderAnswers(desk.intake, desk.dispatcher.control.note)

        def ask(action: str, question: object = None, order: str = "o 1") -> bool:
            payload = b"" if question is None else json.dumps(question).encode()
            return answers.answer(order_key(order, action), payload)[0]

        assert ask("submit", {"id": "o 1", "node": "11"})
        assert ask("pin", {"vehicle": "van-1"})
        assert not ask("pin", {"vehicle": "nobody"})
        assert ask("release")
        assert ask("show")
        assert ask("cancel")
        assert not ask("cancel", order="none")
        with open_reader(f"sqlite:///{tmp_path / 'a.db'}") as reader:
            events = reader.events(0, time.time_ns() + 1, limit=9)[::-1]
        assert [(e.kind, e.subject, e.actor) for e in events] == [
            ("pin", "order/o 1", "bus"),
            ("release", "order/o 1", "bus"),
            ("cancel", "order/o 1", "bus"),
        ]

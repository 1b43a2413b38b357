"""Pause, resume and alarms over HTTP: who did what is in the log."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from slipstream.messages import Alarms
from storage import StorageError

from .conftest import Api

Serve = Callable[..., Api]


def test_pause_and_resume(serve: Serve) -> None:
    """The state is told, readiness stays, each use is logged with the token's name."""
    api = serve(tokens=True)
    api.dispatcher.control.run_soon = lambda: True
    answer = api.ask("POST", "/v1/control/pause", "controller")
    assert answer.status == 200
    assert (answer.json["paused"], answer.json["paused_by"]) == (True, "controller")
    ready = api.get("/readyz")
    assert (ready.status, ready.json["paused"]) == (200, True)
    refused = api.ask("POST", "/v1/control/cycle", "controller")
    assert (refused.status, refused.json["mend"]) == (409, "resume it first")
    api.dispatcher.run_cycle()
    assert api.dispatcher.delivery.cycles == 0
    answer = api.ask("POST", "/v1/control/resume", "controller")
    assert answer.json == {"paused": False, "paused_by": None, "paused_ns": None}
    assert api.ask("POST", "/v1/control/cycle", "controller").status == 202
    log = api.get("/v1/log", "reader").json
    assert [(e["kind"], e["actor"]) for e in log["entries"]] == [
        ("cycle", "controller"),
        ("resume", "controller"),
        ("pause", "controller"),
    ]


def test_a_cycle_while_one_runs_is_refused(serve: Serve) -> None:
    """With what to do."""
    api = serve(tokens=True)
    api.dispatcher.control.run_soon = lambda: False
    answer = api.ask("POST", "/v1/control/cycle", "controller")
    assert (answer.status, "runs now" in answer.json["detail"]) == (409, True)


def test_a_pause_that_cannot_be_stored_is_refused(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It says so, and the dispatcher runs on."""
    api = serve(tokens=True)

    def fail(*_: object) -> None:
        raise StorageError("x.db: disk full")

    monkeypatch.setattr(api.dispatcher.control._store, "save_events", fail)
    answer = api.ask("POST", "/v1/control/pause", "controller")
    assert (answer.status, answer.json["detail"]) == (503, "x.db: disk full")
    assert api.dispatcher.control.paused is None


def test_an_alarm_is_seen_and_acknowledged(serve: Serve) -> None:
    """In the list, in the stream, in the log; by the operator who is named, or by the token."""
    api = serve(tokens=True)
    api.dispatcher.control.pause("ada")
    with api.listening(token="reader") as listener:
        api.watched.update()
        kind, told, number = listener.event()
        assert (kind, told["kind"], number is None) == ("alarm", "paused", False)
        (alarm,) = Alarms.model_validate_json(api.get("/v1/alarms", "reader").body).alarms
        assert told == alarm.model_dump()
        path = f"/v1/alarms/{alarm.id}/acknowledge"
        assert api.ask("POST", path, "reader").status == 403
        answer = api.ask("POST", path, "controller", {"by": "Ada Okafor"})
        assert (answer.status, answer.json["acknowledged_by"]) == (200, "Ada Okafor")
        assert listener.event()[1]["acknowledged_by"] == "Ada Okafor"
    again = api.ask("POST", path, "controller")
    assert again.json == answer.json
    latest = api.get("/v1/log?limit=1", "reader").json
    (entry,) = latest["entries"]
    assert (entry["kind"], entry["actor"], entry["text"]) == (
        "acknowledge",
        "controller",
        "paused acknowledged by Ada Okafor",
    )
    page = api.get(f"/v1/log?before={latest['next']}", "reader").json
    assert [e["kind"] for e in page["entries"]] == ["paused", "pause"]
    assert page["next"] is None
    assert api.get("/v1/log?from=0&until=1", "reader").json["entries"] == []


def test_what_is_done_to_orders_is_logged(serve: Serve) -> None:
    """With the token's name; what was refused is not."""
    api = serve(tokens=True)
    assert api.ask("POST", "/v1/orders", "orderer", {"id": "o 1", "node": "c2"}).status == 201
    path = "/v1/orders/o%201"
    assert api.ask("POST", f"{path}/pin", "controller", {"vehicle": "van-a"}).status == 200
    assert api.ask("POST", f"{path}/release", "controller").status == 200
    assert api.ask("DELETE", path, "orderer").status == 200
    assert api.ask("POST", "/v1/orders/none/pin", "controller").status == 404
    entries = api.get("/v1/log", "reader").json["entries"]
    assert [(e["kind"], e["subject"], e["actor"]) for e in entries] == [
        ("cancel", "order/o 1", "orderer"),
        ("release", "order/o 1", "controller"),
        ("pin", "order/o 1", "controller"),
    ]


def test_what_cannot_be_acknowledged(serve: Serve) -> None:
    """Another id, another body."""
    api = serve(tokens=True)
    api.dispatcher.control.pause("ada")
    api.watched.update()
    missing = api.ask("POST", "/v1/alarms/none/acknowledge", "controller")
    assert (missing.status, missing.json["field"]) == (404, "alarm")
    (alarm,) = api.get("/v1/alarms", "reader").json["alarms"]
    wrong = api.ask("POST", f"/v1/alarms/{alarm['id']}/acknowledge", "controller", {"by": ""})
    assert (wrong.status, wrong.json["field"]) == (422, "by")


def test_a_reason_is_in_the_history_of_the_order_and_in_the_log(serve: Callable[..., Api]) -> None:
    """Of what is cancelled, pinned or released; in one line; and of a pause."""
    api = serve(tokens=True)
    order = {"id": "a/1", "node": "c1"}
    assert api.ask("POST", "/v1/orders", "orderer", order).status == 201
    at = "/v1/orders/a%2F1"
    assert api.ask("POST", f"{at}/pin", "controller", {"vehicle": "van-b", "reason": "asked for"})
    assert (
        api.ask("POST", f"{at}/release", "controller", {"reason": "van-b is\nlate"}).status == 200
    )
    gone = api.ask("DELETE", at, "orderer", {"reason": "the customer is away"})
    assert (gone.status, gone.json["reason"]) == (200, "cancelled: the customer is away")
    assert api.ask("POST", "/v1/control/pause", "controller", {"reason": "snow"}).status == 200
    steps = [step["reason"] for step in api.get(at, "reader").json["history"]]
    assert steps == [
        "submitted",
        "pinned to van-b: asked for",
        "released from van-b: van-b is late",
        "cancelled: the customer is away",
    ]
    said = [entry["text"] for entry in api.get("/v1/log", "reader").json["entries"]]
    assert [text.partition(": ")[2] for text in said] == [
        *("snow", "the customer is away", "van-b is late", "asked for"),
    ]


def test_a_reason_that_is_none_is_refused(serve: Callable[..., Api]) -> None:
    """Nothing is done; without a reason all is as ever."""
    api = serve(tokens=True)
    assert api.ask("POST", "/v1/orders", "orderer", {"id": "o", "node": "c1"}).status == 201
    for body in ({"reason": 7}, {"reason": 501 * "x"}, {"why": "so"}):
        answer = api.ask("DELETE", "/v1/orders/o", "orderer", body)
        assert (answer.status, answer.json["field"]) == (422, next(iter(body)))
    assert api.get("/v1/orders/o", "reader").json["state"] == "open"
    assert api.ask("DELETE", "/v1/orders/o", "orderer").json["reason"] == "cancelled by its caller"

"""The API over the bus: what HTTP answers, asked on keys, through a real router."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import pytest
import zenoh

from dispatcher_daemon.service.api import RateLimit, create_app
from dispatcher_daemon.service.api.auth import SCOPES
from dispatcher_daemon.service.api.gate import MAX_BODY_BYTES
from dispatcher_daemon.service.api.over_bus import ApiOverBus
from dispatcher_daemon.settings import DispatcherSettings, Scope
from slipstream.bus import Bus, Router
from slipstream.config import BusSettings
from slipstream.messages import SegmentState, api_key
from slipstream.messages.base import chunk
from slipstream.zenoh_config import client_config

from .conftest import Api
from .test_solve import DEMO
from .test_vroom import REQUEST

State = Callable[..., SegmentState]


@dataclass
class Reply:
    """An answer over the bus."""

    status: int
    encoding: str
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


@dataclass
class Asker:
    """Who has a bus and no HTTP."""

    session: zenoh.Session

    def ask(
        self, scope: str, method: str, path: str, parameters: str = "", body: object = None
    ) -> Reply:
        """Ask once; the query's parameters are as in a URL."""
        selector = api_key(scope, method, path)
        if parameters:
            selector += "?" + parameters.replace("&", ";")
        payload = None if body is None else json.dumps(body).encode()
        return self.get(selector, payload)

    def get(self, selector: str, payload: bytes | None = None) -> Reply:
        """Ask by zenoh's own means."""
        (reply,) = list(self.session.get(selector, payload=payload, timeout=60.0))
        if reply.ok is None:
            assert reply.err is not None
            body = reply.err.payload.to_bytes()
            return Reply(json.loads(body)["status"], str(reply.err.encoding), body)
        attached = reply.ok.attachment
        assert attached is not None
        assert str(reply.ok.key_expr) == selector.partition("?")[0]
        return Reply(int(attached.to_bytes()), str(reply.ok.encoding), reply.ok.payload.to_bytes())


@pytest.fixture
def over_bus(router: Router) -> Iterator[Callable[..., Asker]]:
    """Serves an API over the bus, and gives one who asks."""
    with ExitStack() as stack:

        def make(
            api: Api, scopes: tuple[Scope, ...] = SCOPES, rate: RateLimit | None = None
        ) -> Asker:
            settings = BusSettings(connect=(router.endpoint,))
            served = ApiOverBus(create_app(api.services), scopes, rate)
            stack.callback(served.close)
            bus = stack.enter_context(Bus.open(settings))
            served.listen(bus)
            session = stack.enter_context(zenoh.open(client_config(settings)))
            ends = time.monotonic() + 30.0
            key = api_key("none", "get", "x")
            while not list(session.get(key, timeout=1.0)):
                assert time.monotonic() < ends
            return Asker(session)

        yield make


@pytest.mark.process
@pytest.mark.slow
def test_answers_are_those_of_http(
    serve: Callable[..., Api], over_bus: Callable[..., Asker], state: State
) -> None:
    """Every reading operation, with parameters, ids of any characters, and refusals."""
    api = serve(tokens=True)
    api.feed(state("avenue_east", 1, time_ns=time.time_ns()))
    api.dispatcher.run_cycle()
    asker = over_bus(api)
    for order in ("o/1", "o;2", "o 3"):
        body = {"id": order, "node": "c2"}
        assert api.ask("POST", "/v1/orders", "orderer", body).status == 201
    (cycle,) = api.get("/v1/cycles", "reader").json["cycles"]
    number = cycle["cycle"]
    cases = [
        ("orders", "limit=2"),
        ("orders", "limit=1&after=o%202"),
        ("orders", "limit=0"),
        ("orders", "colour=red"),
        ("orders", "limit=1&limit=2"),
        (f"orders/{chunk('o/1')}", ""),
        (f"orders/{chunk('o;2')}", ""),
        ("orders/none", ""),
        ("vehicles/van-a", ""),
        ("vehicles/none", ""),
        ("plans/van-a", "limit=5"),
        ("cycles", "limit=1"),
        (f"cycles/{number}", ""),
        (f"cycles/{number}/explain", ""),
        ("cycles/99/explain", ""),
        ("segments", ""),
        ("segments/avenue_east", ""),
        ("energy", "by=day"),
        ("energy", "by=year"),
        ("log", "limit=3"),
        ("feeds/datex2/extension.xsd", ""),
        ("nothing", ""),
    ]
    # What depends on the moment of the question.
    of_now = ("time_ns", "age_s", "from_ns", "until_ns", "silent_s")

    def settled(body: bytes, kind: str) -> Any:
        def without(value: Any) -> Any:
            if isinstance(value, dict):
                return {k: without(v) for k, v in value.items() if k not in of_now}
            return [without(v) for v in value] if isinstance(value, list) else value

        return without(json.loads(body)) if "json" in kind else body

    refused = 0
    for path, parameters in cases:
        there = api.get(f"/v1/{path}?{parameters}", "reader")
        here = asker.ask("read", "get", path, parameters)
        kind = there.headers["content-type"]
        assert here.status == there.status, (path, here)
        assert zenoh.Encoding(kind) == zenoh.Encoding(here.encoding), path
        assert settled(here.body, kind) == settled(there.body, kind), path
        refused += here.status >= 400
    assert refused == 8


@pytest.mark.process
@pytest.mark.slow
def test_orders_and_control_over_the_bus(
    serve: Callable[..., Api], over_bus: Callable[..., Asker]
) -> None:
    """With the status of HTTP; the log says that it came over the bus."""
    api = serve(tokens=True)
    api.dispatcher.control.run_soon = lambda: True
    asker = over_bus(api)
    order = {"id": "a/b", "node": "c2"}
    assert [asker.ask("orders", "post", "orders", body=order).status for _ in "12"] == [201, 200]
    unknown = {"id": "c", "node": "x"}
    refused = asker.ask("orders", "post", "orders", body=unknown)
    there = api.ask("POST", "/v1/orders", "orderer", unknown)
    assert (refused.status, refused.json) == (422, there.json)
    assert refused.encoding == "application/problem+json"
    assert asker.ask("orders", "delete", f"orders/{chunk('a/b')}").json["state"] == "cancelled"
    assert asker.ask("control", "post", "control/pause").json["paused_by"] == "bus"
    assert asker.ask("control", "post", "control/cycle").status == 409
    assert asker.ask("control", "post", "control/resume").json["paused"] is False
    assert asker.ask("control", "post", "control/cycle").status == 202
    log = asker.ask("read", "get", "log").json["entries"]
    assert [(entry["kind"], entry["actor"]) for entry in log if entry["kind"] != "cancel"] == [
        *(("cycle", "bus"), ("resume", "bus"), ("pause", "bus"))
    ]


@pytest.mark.process
@pytest.mark.slow
def test_fleets_and_vrooms_requests_over_the_bus(
    serve: Callable[..., Api], over_bus: Callable[..., Asker], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fleet is checked, planned and looked up; others are answered meanwhile."""
    # On a busy machine a process takes longer to start than a caller waits.
    monkeypatch.setattr("dispatcher_daemon.service.api.endpoints.vroom.WAIT_S", 40.0)
    api = serve(tokens=True)
    asker = over_bus(api)
    checked = asker.ask("control", "post", "solve", "validate_only=true", DEMO)
    assert (checked.status, checked.json["valid"]) == (200, True)
    bad = {**DEMO, "stops": {"s": {"node": "x"}}}
    refused = asker.ask("control", "post", "solve", "validate_only=true", bad)
    there = api.ask("POST", "/v1/solve?validate_only=true", "controller", bad)
    assert (refused.status, refused.json) == (422, there.json)
    job = asker.ask("control", "post", "solve", "deadline_s=1", DEMO)
    assert job.status == 202
    assert asker.ask("read", "get", "vehicles").status == 200
    ends = time.monotonic() + 60.0
    while (now := asker.ask("control", "get", f"solve/{job.json['id']}").json)["state"] != "done":
        assert time.monotonic() < ends, now
        time.sleep(0.1)
    assert now["result"]["plans"]
    solved = asker.ask("control", "post", "vroom", "deadline_s=2", REQUEST).json
    assert (solved["code"], solved["summary"]["unassigned"]) == (0, 1)
    unknown = asker.ask("control", "post", "vroom", body={**REQUEST, "depots": []})
    assert (unknown.status, len(unknown.json["warnings"])) == (200, 1)
    wrong = asker.ask("control", "post", "vroom", body={**REQUEST, "vehicles": []})
    assert (wrong.status, wrong.json["code"]) == (422, 2)


@pytest.mark.attack
@pytest.mark.process
@pytest.mark.slow
def test_a_key_gives_its_scope_and_no_other(
    serve: Callable[..., Api], over_bus: Callable[..., Asker]
) -> None:
    """A key of one scope opens no operation of another, nor what the settings leave out."""
    api = serve(tokens=True)
    asker = over_bus(api, ("read", "orders"))
    body = {"id": "o", "node": "c2"}
    for scope, method, path, sent in (
        ("read", "post", "orders", body),
        ("read", "post", "control/pause", None),
        ("orders", "post", "control/pause", None),
        ("orders", "get", "vehicles", None),
        ("orders", "post", "orders/o/pin", None),
        ("control", "post", "control/pause", None),
        ("control", "get", "vehicles", None),
    ):
        answer = asker.ask(scope, method, path, body=sent)
        assert (answer.status, answer.json["field"]) == (403, "key"), (scope, path)
    assert api.services.control.paused is None
    assert asker.ask("orders", "post", "orders", body=body).status == 201


@pytest.mark.attack
@pytest.mark.process
@pytest.mark.slow
def test_what_is_no_question_of_the_api_is_refused(
    serve: Callable[..., Api], over_bus: Callable[..., Asker]
) -> None:
    """Each by a problem document: patterns, other keys, endless answers, bodies."""
    asker = over_bus(serve(tokens=True))
    root = api_key("read", "get", "")
    for selector, status in (
        (root + "*", 400),
        (root + "**", 400),
        (api_key("control", "*", "control/pause"), 400),
        (api_key("all", "get", "vehicles"), 404),
        (api_key("read", "get", "events"), 404),
        (api_key("read", "put", "vehicles"), 405),
        (api_key("read", "get", "..%2Fhealthz"), 404),
        (root.removesuffix("/get/"), 404),
        (api_key("read", "get", "vehicles") + "?_time=[now(-1s)..]", 200),
        (api_key("read", "get", "cycles") + "?limit=1%3B2", 422),
    ):
        assert asker.get(selector).status == status, selector
    for payload, status in (
        (b"", 415),
        (b"{", 400),
        (b"\xff", 400),
        (b" " * (MAX_BODY_BYTES + 1), 413),
    ):
        assert asker.get(api_key("orders", "post", "orders"), payload).status == status
    large = b" " * (MAX_BODY_BYTES + 1)
    assert asker.get(api_key("control", "post", "solve"), large).status == 400


@pytest.mark.attack
@pytest.mark.process
@pytest.mark.slow
def test_questions_are_limited(serve: Callable[..., Api], over_bus: Callable[..., Asker]) -> None:
    """Those above the rate are refused, as HTTP's are."""
    asker = over_bus(serve(tokens=True), rate=RateLimit(0.001, 3.0))
    found = [asker.ask("read", "get", "vehicles").status for _ in range(5)]
    assert found == [200, 200, 200, 429, 429]


def test_nothing_is_served_over_the_bus_by_default() -> None:
    """A router without access rules lets everybody ask."""
    assert DispatcherSettings().api.bus == ()

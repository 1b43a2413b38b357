from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from dispatcher_daemon import metrics
from dispatcher_daemon.service.api import hub
from dispatcher_daemon.service.api.endpoints import events
from dispatcher_daemon.service.dispatcher.reports import failed_report
from slipstream.http.problems import Problem
from slipstream.messages import SegmentState, Unserved
from tests.dispatcher_daemon.service.waiting import wait_for

from .asgi import Listener
from .conftest import Api

State = Callable[..., SegmentState]


@contextmanager
def connected(api: Api) -> Iterator[Listener]:
    """A caller of the stream of cycles over a connection of its own."""

    def parts() -> Iterator[bytes]:
        rest = b""
        while part := connection.recv(65536):
            *lines, rest = (rest + part).split(b"\n")
            yield b"\n".join(lines)

    with socket.create_connection(("127.0.0.1", api.port), timeout=30) as connection:
        connection.sendall(b"GET /v1/events?kinds=cycle HTTP/1.0\r\nHost: localhost\r\n\r\n")
        listener = Listener(parts())
        assert any(line.startswith("retry") for line in listener.lines)
        yield listener


def test_what_happens_is_told_as_it_happens(serve: Callable[..., Api], state: State) -> None:
    """A state when it comes; orders, plans and the report once their cycle is stored."""
    api = serve()
    with api.listening() as all_of_it, api.listening("?kinds=cycle") as cycles:
        api.feed(state("avenue_east", 1, time_ns=time.time_ns()))
        kind, value, number = all_of_it.event()
        assert (kind, value["segment"], number) == ("state", "avenue_east", None)
        api.dispatcher.run_cycle()
        seen = [all_of_it.event()]
        while seen[-1][0] != "cycle":
            seen.append(all_of_it.event())
        stops = len(api.dispatcher.fleet_watch.vehicles().vehicles["van-a"].offered.plan.stops)  # type: ignore[union-attr]
        assert stops > 2
        kinds = [kind for kind, _, _ in seen]
        assert kinds == sorted(kinds, key=["order", "plan", "cycle"].index)
        assert {"order", "plan"} < set(kinds)
        assert [v["vehicle"] for k, v, _ in seen if k == "plan"] == ["van-a", "van-b"]
        assert seen[-1][1] == api.get("/v1/cycles/1").json["report"]
        assert cycles.event() == seen[-1]


@pytest.mark.slow
def test_a_caller_goes_on_where_it_stopped(serve: Callable[..., Api]) -> None:
    """Events behind the given id come first; where they are gone, `reset` says so."""
    api = serve()
    with api.listening("?kinds=cycle") as listener:
        api.dispatcher.run_cycle()
        _, first, number = listener.event()
    assert first["cycle"] == 1
    api.dispatcher.run_cycle()
    api.dispatcher.run_cycle()
    with api.listening("?kinds=cycle", number) as again:
        assert [again.event()[1]["cycle"] for _ in range(2)] == [2, 3]
    for unknown in ("1-1", "nonsense", f"{str(number).partition('-')[0]}-99999"):
        with api.listening("?kinds=cycle", unknown) as lost:
            assert lost.event()[0] == "reset"


@pytest.mark.slow
def test_heartbeats_keep_a_quiet_stream_open(
    serve: Callable[..., Api], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A comment comes where nothing happens."""
    monkeypatch.setattr(events, "HEARTBEAT_S", 0.05)
    with serve().listening() as listener:
        assert sum(next(listener.lines) == ": heartbeat" for _ in range(20)) > 5


@pytest.mark.slow
def test_a_caller_that_does_not_read_is_dropped_and_holds_nobody_up(
    serve: Callable[..., Api], state: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its stream ends, the other one gets all, and publishing never waits."""
    monkeypatch.setattr(events, "SEND_WITHIN_S", 0.5)
    api = serve(sockets=True)
    api.dispatcher.run_cycle()
    report = api.services.reader.latest_cycle()
    assert report is not None
    large = report.model_copy(update={"reason": "x" * 100_000})
    dropped = metrics.API_STREAMS_DROPPED._value.get()
    with connected(api) as slow, connected(api) as quick:
        longest_s = 0.0
        for number in range(300):
            began = time.monotonic()
            api.services.events.publish("cycle", large)
            longest_s = max(longest_s, time.monotonic() - began)
            assert quick.event()[0] == "cycle", number
        assert longest_s < 5.0
        assert wait_for(lambda: metrics.API_STREAMS_DROPPED._value.get() == dropped + 1)
        assert metrics.API_STREAMS._value.get() == 1
        assert slow.rest() < 300


def test_what_waits_for_a_caller_is_bounded(state: State) -> None:
    """States by segments and RSUs: the newest replaces the one before. Others by their number."""
    report = failed_report(1, 0, 0.0, "a reason")

    async def overwhelm() -> tuple[list[Any], list[hub.HubEvent]]:
        told = hub.EventHub(1)
        stream = told.open(hub.KINDS, None, "somebody")
        for number in range(50):
            told.publish("state", state("avenue_east", 1, sequence=number))
        found = [event.value for event in await stream.take(5.0)]
        for _ in range(hub.MAX_WAITING + 2):
            told.publish("cycle", report)
        assert not stream.closed
        return found, await stream.take(5.0)

    (newest,), (reset, *others) = asyncio.run(overwhelm())
    assert newest.sequence == 49
    assert reset.kind == "reset"
    assert [event.id for event in others] == [f"1-{hub.MAX_WAITING + 2}"]


def test_what_is_kept_is_bounded_in_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand reports that each name thousands of waiting orders would be gigabytes. A caller
    that comes back for what is gone is told so; one that missed less gets it.
    """
    monkeypatch.setattr(hub, "KEPT_BYTES", 100_000)
    waiting = tuple(Unserved(stop=f"o{n}", reason="nobody is free for it") for n in range(400))
    report = failed_report(1, 0, 0.0, "a reason").model_copy(update={"unserved": waiting})
    size = len(report.to_bytes())

    async def come_back() -> list[list[hub.HubEvent]]:
        told = hub.EventHub(1)
        for _ in range(50):
            told.publish("cycle", report)
        late = [told.open(("cycle",), f"1-{number}", f"{number}") for number in (1, 47)]
        return [await stream.take(5.0) for stream in late]

    long_away, short = asyncio.run(come_back())
    assert 100_000 / 6 < size < 100_000 / 3
    assert [event.kind for event in long_away] == ["reset"]
    assert [event.id for event in short] == ["1-48", "1-49", "1-50"]


def test_streams_are_bounded_and_end_with_the_dispatcher(
    serve: Callable[..., Api], monkeypatch: pytest.MonkeyPatch
) -> None:
    """503 beyond the limit; at the end each stream ends by itself."""
    monkeypatch.setattr(hub, "MAX_STREAMS", 1)
    api = serve()
    with api.listening() as only:
        assert api.get("/v1/events").status == 503
        api.services.events.close_all()
        with pytest.raises(EOFError):
            only.event()


@pytest.mark.parametrize("token", ["reader", None])
def test_no_caller_takes_all_streams(
    serve: Callable[..., Api], monkeypatch: pytest.MonkeyPatch, token: str | None
) -> None:
    """429 beyond a token's share, or an address's without one, until a stream ends."""
    monkeypatch.setattr(hub, "MAX_STREAMS_OF_ONE", 2)
    api = serve(tokens=token is not None)
    with api.listening(token=token):
        with api.listening(token=token):
            refused = api.get("/v1/events", token)
            assert (refused.status, refused.headers["retry-after"]) == (429, "10")
            named = "the address 127.0.0.1" if token is None else "the token 'reader'"
            assert refused.json["detail"].startswith(f"2 streams of {named} are open")
        with api.listening(token=token):
            pass


def test_others_are_served_beside_a_caller_that_has_its_share() -> None:
    """Up to the most of all callers, which is a 503."""

    async def fill() -> list[int]:
        told, refused = hub.EventHub(1), []
        for number in range(hub.MAX_STREAMS + 1):
            try:
                told.open(hub.KINDS, None, f"caller {number // (hub.MAX_STREAMS_OF_ONE + 1)}")
            except Problem as problem:
                refused.append(problem.status)
        return refused

    assert asyncio.run(fill()) == [429] * (hub.MAX_STREAMS // (hub.MAX_STREAMS_OF_ONE + 1))
    assert hub.MAX_STREAMS_OF_ONE <= hub.MAX_STREAMS / 4

"""The bus: delivery, late joiners, recovery."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import pytest
import zenoh

from slipstream.bus import Bus, Publisher, Router, free_port, zenoh_config
from slipstream.bus.inbox import SAMPLES
from slipstream.bus.zenoh_config import client_config, router_config
from slipstream.config import BusSettings
from slipstream.errors import InputError
from slipstream.messages import ENCODING, SCHEMA, SegmentState, decode
from tests.slipstream.sent import a_state


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sessions look for their router often."""
    monkeypatch.setattr(zenoh_config, "RETRY", {"period_init_ms": 20, "period_max_ms": 100})


OTHER_ENCODING = ENCODING.replace(f"={SCHEMA}", f"={SCHEMA + 1}")


class Inbox:
    """Collects payloads and waits for one."""

    def __init__(self) -> None:
        self.got: list[bytes] = []
        self._changed = threading.Condition()

    def __call__(self, key: str, payload: bytes) -> None:
        """Take one sample."""
        with self._changed:
            self.got.append(payload)
            self._changed.notify_all()

    def wait_for(self, payload: bytes, seconds: float = 10.0) -> bool:
        """True once the payload has come."""
        with self._changed:
            return self._changed.wait_for(lambda: payload in self.got, seconds)


@pytest.mark.slow
def test_late_subscribers_get_the_last_samples(router: Router, bus: Bus) -> None:
    """A publisher's cache serves those who come later, no more than asked for."""
    publisher = bus.publisher("slipstream/v1/x/state", history=2)
    for number in range(4):
        publisher.put(str(number).encode())
    with Bus.open(BusSettings(connect=(router.endpoint,))) as late:
        inbox = Inbox()
        late.subscribe("slipstream/v1/*/state", inbox, every=True)
        assert inbox.wait_for(b"3")
        assert inbox.got == [b"2", b"3"]


@pytest.mark.slow
def test_a_session_knows_whether_a_router_answers() -> None:
    """Not before one is there, then as long as it is."""

    def becomes(connected: bool) -> bool:
        deadline = time.monotonic() + 30
        while bus.is_connected != connected and time.monotonic() < deadline:
            time.sleep(0.05)
        return bus.is_connected == connected

    port = free_port()
    with Bus.open(BusSettings(connect=(f"tcp/127.0.0.1:{port}",))) as bus:
        assert not bus.is_connected
        with Router(port):
            assert becomes(True)
        assert becomes(False)
    assert not bus.is_connected


@pytest.mark.long
def test_the_session_opens_without_a_router_and_finds_it_later() -> None:
    """Order of start does not matter, and a router that comes back is found again."""
    port = free_port()
    settings = BusSettings(connect=(f"tcp/127.0.0.1:{port}",))
    began = time.monotonic()
    with Bus.open(settings) as sender, Bus.open(settings) as receiver:
        assert time.monotonic() - began < 5
        inbox = Inbox()
        receiver.subscribe("slipstream/v1/x", inbox)
        publisher = sender.publisher("slipstream/v1/x")
        publisher.put(b"before the router")
        with Router(port):
            assert inbox.wait_for(b"before the router", 20)
        time.sleep(1.0)
        publisher.put(b"while it is gone")
        with Router(port):
            assert inbox.wait_for(b"while it is gone", 20)


@pytest.mark.long
def test_expected_keys_reach_all_that_listen() -> None:
    """Those that subscribed before and after, also once the router has come back."""
    port = free_port()
    settings = BusSettings(connect=(f"tcp/127.0.0.1:{port}",))
    key, before, after = "slipstream/v1/fleet/van/position", Inbox(), Inbox()
    with Bus.open(settings) as sender, Bus.open(settings) as receiver:
        receiver.subscribe("slipstream/v1/fleet/*/position", before, history=False)
        receiver.expect([key, "slipstream/v1/fleet/other/position"])
        receiver.subscribe("slipstream/v1/**", after, history=False)
        publisher = sender.publisher(key, history=0)
        with Router(port):
            _put_until(publisher, b"first", before, after)
        # Within one process, a session may connect to a router that is closing and never learn of
        # its end; a router's process takes its connections along.
        time.sleep(1.0)
        with Router(port):
            _put_until(publisher, b"second", before, after)


def _put_until(publisher: Publisher, payload: bytes, *inboxes: Inbox) -> None:
    deadline = time.monotonic() + 30
    while any(payload not in inbox.got for inbox in inboxes):
        assert time.monotonic() < deadline
        publisher.put(payload)
        time.sleep(0.05)


@pytest.mark.long
def test_a_burst_is_not_dropped_on_its_way(router: Router) -> None:
    """10,000 messages of a state's size at once; by zenoh's defaults some half of them is lost.

    A machine that stands still for longer than a publisher waits loses some too: one burst of five
    has to come whole.
    """
    received = [0] * 5
    changed = threading.Condition()

    def count(key: str, payload: bytes) -> None:
        with changed:
            received[payload[0]] += 1
            changed.notify()

    settings = BusSettings(connect=(router.endpoint,))
    with Bus.open(settings) as sender, Bus.open(settings) as receiver:
        receiver.subscribe("slipstream/v1/x/*", count, history=False, every=True)
        publishers = [sender.publisher(f"slipstream/v1/x/{n}", history=0) for n in range(100)]
        deadline = time.monotonic() + 30
        while not all(publisher.has_subscribers() for publisher in publishers):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        for burst in range(5):
            for _ in range(100):
                for publisher in publishers:
                    publisher.put(bytes([burst]) * 600)
            with changed:
                if changed.wait_for(lambda: 10_000 in received, 10):
                    break
    assert 10_000 in received, received


@pytest.mark.slow
def test_a_handler_that_raises_does_not_end_delivery(bus: Bus) -> None:
    """A fault in one message leaves the next ones alone."""
    inbox = Inbox()

    def handler(key: str, payload: bytes) -> None:
        if payload == b"bad":
            raise RuntimeError("boom")
        inbox(key, payload)

    bus.subscribe("slipstream/v1/x", handler, every=True)
    publisher = bus.publisher("slipstream/v1/x", history=5)
    for payload in (b"bad", b"good"):
        publisher.put(payload)
    assert inbox.wait_for(b"good")


@pytest.mark.slow
def test_pictures_know_whether_anybody_looks(router: Router, bus: Bus) -> None:
    """has_subscribers follows the subscribers."""
    publisher = bus.publisher("slipstream/v1/p", best_effort=True)
    assert not publisher.has_subscribers()
    inbox = Inbox()
    with Bus.open(BusSettings(connect=(router.endpoint,))) as viewer:
        viewer.subscribe("slipstream/v1/p", inbox, history=False)
        deadline = time.monotonic() + 60
        while not publisher.has_subscribers() and time.monotonic() < deadline:
            time.sleep(0.05)
        assert publisher.has_subscribers()
        publisher.put(b"picture")
        assert inbox.wait_for(b"picture")


def test_a_taken_port_and_a_nonsense_endpoint_are_bad_input(router: Router) -> None:
    """One clear line each."""
    port = int(router.endpoint.rpartition(":")[2])
    with pytest.raises(InputError, match=str(port)):
        Router(port)
    with pytest.raises(InputError, match="nonsense"):
        Bus.open(BusSettings(connect=("nonsense",)))


@pytest.mark.slow
def test_close_ends_all_threads(router: Router) -> None:
    """Nothing of a closed session runs on."""
    session = Bus.open(BusSettings(connect=(router.endpoint,)))
    session.subscribe("slipstream/v1/x", lambda *_: None)
    session.close()
    assert not [t for t in threading.enumerate() if t.name.startswith("bus ")]


@pytest.mark.long
@pytest.mark.slow
def test_each_message_says_its_schema_version(router: Router, bus: Bus) -> None:
    """As the suffix of its encoding, early and live, declared or not; pictures say nothing."""
    seen: dict[str, str] = {}
    key = "slipstream/v1/{}/state".format
    early = bus.publisher(key("early"))
    early.put(a_state())
    with zenoh.open(client_config(BusSettings(connect=(router.endpoint,)))) as session:
        subscriber = zenoh.ext.declare_advanced_subscriber(
            session,
            key("*"),
            lambda sample: seen.update({str(sample.key_expr): str(sample.encoding)}),
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
        )
        live = bus.publisher(key("live"), history=0)
        picture = bus.publisher(key("picture"), best_effort=True)
        deadline = time.monotonic() + 20
        while len(seen) < 4 and time.monotonic() < deadline:
            live.put(a_state())
            picture.put(b"picture")
            bus.put(key("once"), a_state())
            time.sleep(0.02)
        subscriber.undeclare()
    ours = {key(name): f"application/json;version={SCHEMA}" for name in ("early", "live", "once")}
    assert seen == ours | {key("picture"): "zenoh/bytes"}


@pytest.mark.slow
def test_other_schema_versions_over_the_bus(router: Router, bus: Bus) -> None:
    """What has no version is read; one of another version is refused, counted."""
    key, taken = "slipstream/v1/versions/state", list[SegmentState]()
    changed = threading.Condition()

    def take(_: str, payload: bytes) -> None:
        with changed:
            taken.append(decode(SegmentState, payload, key))
            changed.notify_all()

    def refused() -> int:
        return int(SAMPLES.labels(key, "version")._value.get())

    plain = a_state().to_bytes()
    bus.subscribe(key, take, history=False, every=True)
    with zenoh.open(client_config(BusSettings(connect=(router.endpoint,)))) as other:
        deadline = time.monotonic() + 60
        while not taken and time.monotonic() < deadline:
            other.put(key, plain)
            time.sleep(0.02)
        before = refused()
        other.put(key, plain, encoding=OTHER_ENCODING)
        other.put(key, plain)
        with changed:
            count = len(taken)
            assert changed.wait_for(lambda: refused() > before and len(taken) >= count, 60)
    assert refused() == before + 1
    assert all(state == a_state() for state in taken)


@pytest.mark.slow
def test_questions_of_another_version_are_refused(router: Router, bus: Bus) -> None:
    """By an answer that says so; answers say their version too."""
    asked = list[bytes]()

    def answer(_: str, payload: bytes) -> tuple[bool, bytes]:
        asked.append(payload)
        return payload != b"bad", b"{}"

    bus.answer("slipstream/v1/x/ask", answer)
    with zenoh.open(client_config(BusSettings(connect=(router.endpoint,)))) as session:

        def ask(payload: bytes, encoding: str) -> zenoh.Reply | None:
            found = list(
                session.get("slipstream/v1/x/ask", payload=payload, encoding=encoding, timeout=5.0)
            )
            return found[0] if found else None

        deadline = time.monotonic() + 20
        while (first := ask(b"{}", "zenoh/bytes")) is None or first.ok is None:
            assert time.monotonic() < deadline
        assert str(first.ok.encoding) == ENCODING
        bad = ask(b"bad", ENCODING)
        assert bad is not None
        assert bad.err is not None
        assert str(bad.err.encoding) == ENCODING
        other = ask(b"other", OTHER_ENCODING)
        assert other is not None
        assert other.err is not None
        assert b"schema '2', where 1 is read" in other.err.payload.to_bytes()
    assert b"other" not in asked


def test_a_session_says_why_it_has_no_router(tmp_path: Path) -> None:
    """Nobody listens; or a router does, and the password is another one."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    (tmp_path / "password").write_text("wrong\n")
    (tmp_path / "users").write_text("van:right\n")
    password = tmp_path / "password"
    settings = BusSettings(connect=(endpoint,), user="van", password_file=password)
    with Bus.open(settings) as bus:
        assert bus.fault() == f"no router answers at {endpoint}"
        config = router_config(endpoint)
        users = json.dumps(str(tmp_path / "users"))
        config.insert_json5("transport/auth/usrpwd/dictionary_file", users)
        router = zenoh.open(config)
        try:
            why = bus.fault()
        finally:
            router.close()
        assert why is not None
        assert why.startswith(f"a router listens at {endpoint} and does not let it in")

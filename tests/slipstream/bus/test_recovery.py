"""What is published while the router is away arrives once it is back: once, and in order."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from slipstream.bus import KEPT, Bus, free_port
from slipstream.bus.inbox import MISSED
from slipstream.config import BusSettings
from slipstream.messages import (
    ALL_ACKNOWLEDGEMENTS,
    ALL_PLANS,
    ALL_PROGRESS,
    ALL_STATES,
    CYCLE_KEY,
    acknowledgement_key,
    plan_key,
    progress_key,
    state_key,
)

pytestmark = [pytest.mark.process, pytest.mark.long]

_ROUTER = """
import sys
from slipstream.bus import Router
with Router(int(sys.argv[1])):
    print("up", flush=True)
    sys.stdin.read()
"""
KEYS = {
    ALL_PLANS: plan_key("van"),
    ALL_ACKNOWLEDGEMENTS: acknowledgement_key("van"),
    ALL_PROGRESS: progress_key("van"),
    CYCLE_KEY: CYCLE_KEY,
    ALL_STATES: state_key("rsu", "street"),
}
AWAY = [f"away {number}" for number in range(10)]


@contextmanager
def router(port: int) -> Iterator[None]:
    """A router as a process of its own, killed at the end."""
    with subprocess.Popen(
        [sys.executable, "-c", _ROUTER, str(port)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        yield
        process.send_signal(signal.SIGKILL)


class Heard:
    """Payloads by the end of their key."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self.got: dict[str, list[str]] = {name.rpartition("/")[2]: [] for name in KEYS}

    def take(self, key: str, payload: bytes) -> None:
        """One sample."""
        with self._changed:
            self.got[key.rpartition("/")[2]].append(payload.decode())
            self._changed.notify()

    def wait_for(self, payload: str, kinds: set[str]) -> None:
        """Wait until it is the latest of these kinds."""
        with self._changed:
            assert self._changed.wait_for(
                lambda: all(self.got[kind][-1:] == [payload] for kind in kinds), 60
            ), (payload, self.got)


def test_what_a_killed_router_kept_away_arrives_once_and_in_order() -> None:
    """As many of each kind as are kept; the rest is counted; a state that is old does not come."""
    port, heard = free_port(), Heard()
    settings = BusSettings(connect=(f"tcp/127.0.0.1:{port}",))
    before = {name: MISSED.labels(name)._value.get() for name in KEYS}
    with Bus.open(settings) as sender, Bus.open(settings) as receiver:
        for name in KEYS:
            receiver.subscribe(name, heard.take, history=name != ALL_STATES, every=True)
        publishers = {
            name: sender.publisher(key, history=0 if name == ALL_STATES else None)
            for name, key in KEYS.items()
        }

        def put(payload: str) -> None:
            for publisher in publishers.values():
                publisher.put(payload.encode())

        with router(port):
            deadline = time.monotonic() + 30
            while not publishers[ALL_STATES].has_subscribers():
                assert time.monotonic() < deadline
                time.sleep(0.05)
            put("first")
            heard.wait_for("first", set(heard.got))
        for _ in range(2):
            deadline = time.monotonic() + 30
            while publishers[ALL_STATES].has_subscribers():
                assert time.monotonic() < deadline
                time.sleep(0.05)
            for payload in AWAY:
                put(payload)
            with router(port):
                heard.wait_for(AWAY[-1], set(heard.got) - {"state"})
                deadline = time.monotonic() + 30
                while not publishers[ALL_STATES].has_subscribers():
                    assert time.monotonic() < deadline
                    time.sleep(0.05)
                put("after")
                heard.wait_for("after", set(heard.got))
    for name in KEYS:
        kind = name.rpartition("/")[2]
        kept = 0 if kind == "state" else KEPT.get(kind, 1)
        outage = [*AWAY[len(AWAY) - kept :], "after"]
        assert heard.got[kind] == ["first", *outage, *outage]
        missed = MISSED.labels(name)._value.get() - before[name]
        assert missed == (0 if kind == "state" else 2 * (len(AWAY) - kept))

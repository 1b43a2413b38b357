"""The real dashboard: whatever fails is named within five seconds, and nothing stays green."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator

import pytest

from slipstream.bus import Bus, free_port
from slipstream.config import BusSettings
from slipstream.messages import (
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    plan_key,
    rsu_health_key,
    state_key,
)
from tests.dashboard.web.conftest import Stream, follow

pytestmark = [pytest.mark.process, pytest.mark.long]
S = 1_000_000_000
NAMED_WITHIN_S = 5.0
ROUTER = """
import sys, threading
from slipstream.bus import Router
with Router(int(sys.argv[1])):
    threading.Event().wait()
"""
START = """
import json, sys
from dashboard.daemon import run_dashboard
from dashboard.settings import DashboardSettings
run_dashboard(DashboardSettings.model_validate(json.loads(sys.argv[1])))
"""


class City:
    """What the other daemons send, twice a second; each part can be taken away."""

    def __init__(self, world, make_sender, endpoint: str) -> None:
        self.dispatcher_lives = True
        self.rsu_status = "ok"
        self._world, self._make_sender, self._endpoint = world, make_sender, endpoint
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        world = self._world
        with Bus.open(BusSettings(connect=(self._endpoint,))) as bus:
            sender, now_ns = self._make_sender(bus, world), time.time_ns()
            sender.put(CYCLE_KEY, world.cycle(1, now_ns))
            for van in ("van-a", "van-b"):
                sender.put(plan_key(van), world.plan(van, 1, now_ns))
            while not self._stop.wait(0.5):
                now_ns = time.time_ns()
                for segment in ("avenue_east", "avenue_west"):
                    state = world.state(segment, now_ns)
                    sender.put(state_key(state.rsu, segment), state)
                    status = self.rsu_status if segment == "avenue_west" else "ok"
                    health = world.health(segment, now_ns, status)
                    sender.put(rsu_health_key(state.rsu), health)
                if self.dispatcher_lives:
                    sender.put(DISPATCHER_HEALTH_KEY, world.dispatcher(now_ns))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def started() -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Starts Python processes that end with the test."""
    running = []

    def start(*arguments: str) -> subprocess.Popen[bytes]:
        running.append(subprocess.Popen([sys.executable, *arguments]))
        return running[-1]

    yield start
    for process in running:
        process.kill()
        process.wait()


def _follow(port: int) -> Stream:
    deadline = time.monotonic() + 60
    while True:
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{port}/api/config", timeout=5).close()
            return follow(port)
        except OSError:
            assert time.monotonic() < deadline
            time.sleep(0.1)


class Browser:
    """A browser's tables, brought up to date by the stream."""

    def __init__(self, stream: Stream) -> None:
        self.stream = stream
        self.moment = stream.next()[1]

    def until(self, met: Callable[[dict], bool], within_s: float = 60.0) -> float:
        """Read until a condition is met; returns the time that it took, s."""
        begun = time.monotonic()
        while not met(self.moment):
            assert time.monotonic() < begun + within_s, self.moment["status"]
            kind, told = self.stream.next()
            if kind == "moment":
                self.moment = told
                continue
            for table, rows in told.pop("set").items():
                for name, row in rows.items():
                    self.moment[table][name] = self.moment[table].get(name, {}) | row
            for table, names in told.pop("del").items():
                for name in names:
                    self.moment[table].pop(name)
            self.moment |= told
        return time.monotonic() - begun


def _named(subject: str) -> Callable[[dict], bool]:
    return lambda moment: subject in [item["subject"] for item in moment["status"]["items"]]


def _router_and_page(tmp_path, started):
    """A router, its endpoint, and the port of a page whose database is not there."""
    bus_port, port = free_port(), free_port()
    router = started("-c", ROUTER, str(bus_port))
    endpoint = f"tcp/127.0.0.1:{bus_port}"
    settings = {
        "bus": {"connect": [endpoint]},
        "port": port,
        "scene_port": None,
        "database_url": f"sqlite:///{tmp_path}/none.db",
    }
    started("-c", START, json.dumps(settings))
    return router, endpoint, port


def test_what_fails_is_named_within_five_seconds(tmp_path, world, make_sender, started):
    """A missing database, a camera without a picture, a killed dispatcher, a killed router."""
    router, endpoint, port = _router_and_page(tmp_path, started)
    city = City(world, make_sender, endpoint)
    try:
        browser = Browser(_follow(port))
        # All that sends is heard, so that the only trouble is the database that is not there.
        browser.until(
            lambda moment: (
                len(moment["vehicles"]) == 2
                and moment["roads"].get("avenue_east", {}).get("level") == "ok"
                and [item["subject"] for item in moment["status"]["items"]] == ["database"]
            )
        )
        city.rsu_status = "no_signal"
        assert browser.until(_named("rsu/rsu-avenue_west")) < NAMED_WITHIN_S
        city.dispatcher_lives = False
        assert browser.until(_named("dispatcher")) < NAMED_WITHIN_S + 0.5
        assert browser.moment["next_cycle"] is None
        router.kill()
        assert browser.until(_named("bus")) < NAMED_WITHIN_S
        assert browser.moment["status"]["items"][0]["subject"] == "bus"
        assert browser.moment["status"]["level"] == "bad"

        def nothing_green(moment: dict) -> bool:
            rows = (r for t in ("vehicles", "roads", "rsus") for r in moment[t].values())
            return "ok" not in {row["level"] for row in rows}

        browser.until(nothing_green)
    finally:
        city.close()
        browser.stream.connection.close()


@pytest.mark.nightly
def test_a_router_that_hangs_is_named_alone(tmp_path, world, make_sender, started):
    """Within five seconds, though its link stands; until it goes on nobody else is blamed."""
    router, endpoint, port = _router_and_page(tmp_path, started)
    city = City(world, make_sender, endpoint)

    def subjects(moment: dict) -> list[str]:
        return [item["subject"] for item in moment["status"]["items"]]

    try:
        browser = Browser(_follow(port))
        browser.until(lambda moment: len(moment["rsus"]) == 2 and subjects(moment) == ["database"])
        named: set[str] = set()

        def told(moment: dict) -> bool:
            named.update(subjects(moment))
            return "bus" in named

        router.send_signal(signal.SIGSTOP)
        assert browser.until(told) < NAMED_WITHIN_S
        begun = time.monotonic()
        # Beyond the time after which each sender by itself is silent, and zenoh's own lease.
        browser.until(lambda moment: told(moment) and time.monotonic() > begun + 9)
        assert named == {"bus", "database"}
        router.send_signal(signal.SIGCONT)
        browser.until(lambda moment: told(moment) and subjects(moment) == ["database"])
        assert named == {"bus", "database"}
    finally:
        router.send_signal(signal.SIGCONT)
        city.close()
        browser.stream.connection.close()

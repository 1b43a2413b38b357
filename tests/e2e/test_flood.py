"""Floods on the bus, against the real router, dispatcher and dashboard."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Generic, TypeVar

import psutil
import pytest
import tomli_w
from prometheus_client.parser import text_string_to_metric_families

from slipstream.bus import Bus, free_port
from slipstream.bus.inbox import OUTCOMES
from slipstream.config import BusSettings
from slipstream.messages import (
    ALL_STATES,
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    CycleReport,
    DispatcherHealth,
    Message,
    decode,
    state_key,
)
from slipstream_lab.benchmarks.service.grid import write_grid
from slipstream_lab.benchmarks.service.senders import a_state

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
INTERVAL_S = 4.0
STATE = a_state("r", "s", sequence=1, time_ns=1)
FLEET = {
    "depots": [{"id": "yard", "node": "0.0"}],
    "vehicles": [{"id": "van-a", "depot": "yard"}],
    "stops": [{"id": "shop", "node": "2.2"}],
}
M = TypeVar("M", bound=Message)

pytestmark = [pytest.mark.attack, pytest.mark.process, pytest.mark.alone]

_SENDER = """
import json, sys, time, zenoh
endpoint, password, key, messages = *sys.argv[1:4], json.loads(sys.argv[4])
config = zenoh.Config()
for name, value in {
    "mode": "client",
    "connect/endpoints": [endpoint],
    "scouting/multicast/enabled": False,
    "transport/shared_memory/enabled": False,
    "transport/auth/usrpwd": {"user": "edge-rsu-1", "password": password},
}.items():
    config.insert_json5(name, json.dumps(value))
with zenoh.open(config) as session:
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    time.sleep(1.0)
    for number, size in messages:
        payload = zenoh.ZBytes(bytes(size))
        for _ in range(number):
            publisher.put(payload)
    time.sleep(1.0)
"""


@dataclass
class Daemon:
    """A process of the product with its metrics."""

    process: subprocess.Popen[bytes]
    metrics_port: int
    peak_mb: float = 0.0

    def sample(self) -> None:
        """Measure its resident memory."""
        resident = psutil.Process(self.process.pid).memory_info().rss / 1e6
        self.peak_mb = max(self.peak_mb, resident)

    def metric(self, name: str, **labels: str) -> float:
        """Sum of a metric's samples that have these labels; 0 while it is not served."""
        address = f"http://127.0.0.1:{self.metrics_port}/metrics"
        try:
            with urllib.request.urlopen(address, timeout=10) as answer:
                text = answer.read().decode()
        except OSError:
            return 0.0
        return sum(
            sample.value
            for family in text_string_to_metric_families(text)
            for sample in family.samples
            if sample.name == name and labels.items() <= sample.labels.items()
        )


class Reports(Generic[M]):
    """Messages of one kind from the bus."""

    def __init__(self, kind: type[M]) -> None:
        self._kind = kind
        self._changed = threading.Condition()
        self.got: list[M] = []

    def take(self, key: str, payload: bytes) -> None:
        """One message."""
        with self._changed:
            self.got.append(decode(self._kind, payload, key))
            self._changed.notify()

    def wait_for(self, number: int, timeout_s: float = 60.0) -> None:
        """Wait until so many have come."""
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.got) >= number, timeout_s)


def longest_gap_s(times_ns: Sequence[int]) -> float:
    """Longest time between two of them that follow each other, s."""
    return max(1e-9 * (b - a) for a, b in pairwise(times_ns))


@contextmanager
def started(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    """A Python process that is killed at the end."""
    process = subprocess.Popen([sys.executable, *command])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


USERS = ("dispatcher", "dashboard", "edge-rsu-1")


def identity(folder: Path, port: int, user: str) -> BusSettings:
    """How a user of the bus reaches the router of a `server`."""
    connect = (f"tcp/127.0.0.1:{port}",)
    return BusSettings(connect=connect, user=user, password_file=folder / "password")


@contextmanager
def server(
    folder: Path,
    dispatcher: Mapping[str, object],
    names: Sequence[str] = ("dispatcher", "dashboard"),
    shared: Mapping[str, object] | None = None,
) -> Iterator[tuple[int, dict[str, Daemon]]]:
    """Router and daemons of a server, each with its identity; gives the router's port and them.

    ``shared`` is what stands at the top of their site file beside database and bus.
    """
    port = free_port()
    (folder / "bus-users").write_text("".join(f"{user}:secret\n" for user in USERS))
    (folder / "password").write_text("secret")
    router = folder / "router.json5"
    text = (DEPLOY / "zenoh" / "router.json5").read_text()
    for shipped, here in {
        "127.0.0.1:7447": f"127.0.0.1:{port}",
        "/run/credentials/slipstream-router.service": str(folder),
        # One sender stands for the RSUs.
        "rsu/rsu-1/segment/avenue_east/state": "rsu/*/segment/*/state",
    }.items():
        assert shipped in text
        text = text.replace(shipped, here)
    router.write_text(text)
    commands = {
        "router": (str(DEPLOY.parent / "slipstream_cli" / "daemons" / "router.py"), str(router))
    }
    ports = {"router": 0}
    for name, settings in {
        "dispatcher": dispatcher,
        "dashboard": {"port": free_port(), "scene_port": free_port()},
    }.items():
        if name not in names:
            continue
        ports[name] = free_port()
        path = folder / f"{name}.toml"
        bus = identity(folder, port, name).model_dump(
            mode="json", exclude={"user"}, exclude_none=True
        )
        site = {
            "database_url": f"sqlite:///{folder / 'slipstream.db'}",
            "bus": bus,
            **(shared or {}),
            name: {**settings, "metrics_port": ports[name]},
        }
        path.write_text(tomli_w.dumps(site))
        commands[name] = ("-m", "slipstream_cli", name, "--config", str(path))
    with ExitStack() as stack:
        yield (
            port,
            {
                name: Daemon(stack.enter_context(started(*command)), ports[name])
                for name, command in commands.items()
            },
        )


@pytest.mark.nightly
def test_messages_too_large_are_refused_in_bounded_memory(
    tmp_path: Path, full_size: bool, figure: Callable[[str], None]
) -> None:
    """300 messages of 5 MB and one of 900 MB: memory, cycles and what is counted."""
    number, huge = (300, 900_000_000) if full_size else (30, 100_000_000)
    settings = {"interval_s": INTERVAL_S, "deadline_s": 1.0, "solvers": ["exact"]}
    with server(tmp_path, settings) as (port, daemons):
        cycles = Reports(CycleReport)
        with Bus.open(identity(tmp_path, port, "dashboard")) as bus:
            bus.subscribe(CYCLE_KEY, cycles.take, every=True)
            cycles.wait_for(2, 120)
            key = state_key("rsu-1", "avenue_east")
            sent = json.dumps([[number, 5_000_000], [1, huge]])
            with started("-c", _SENDER, f"tcp/127.0.0.1:{port}", "secret", key, sent) as sender:
                while sender.poll() is None:
                    for daemon in daemons.values():
                        daemon.sample()
                    time.sleep(0.02)
                assert sender.returncode == 0
            cycles.wait_for(len(cycles.got) + 2)
        refused = {
            name: daemons[name].metric("slipstream_bus_samples_total", outcome="oversized")
            for name in ("dispatcher", "dashboard")
        }
    gap = longest_gap_s([report.started_ns for report in cycles.got]) / INTERVAL_S
    peaks = {name: round(daemon.peak_mb) for name, daemon in daemons.items()}
    figure(f"{number} of 5 MB, one of {huge / 1e6:.0f} MB: peaks, MB {peaks}; refused {refused}")
    figure(f"longest gap between cycles {gap:.2f} intervals")
    assert peaks["router"] < 150
    assert peaks["dispatcher"] < 300
    assert peaks["dashboard"] < 250
    assert refused["dispatcher"] >= number
    assert gap <= 1.5


def settled(dispatcher: Daemon) -> dict[str, float]:
    """Its states by what became of them, once no more are taken."""
    deadline, before = time.monotonic() + 30, {}
    while time.monotonic() < deadline:
        now = {
            outcome: dispatcher.metric(
                "slipstream_bus_samples_total", subscription=ALL_STATES, outcome=outcome
            )
            for outcome in OUTCOMES
        }
        if now == before:
            break
        before = now
        time.sleep(0.5)
    return before


_RSUS = """
import json, sys, time
from msgspec.structs import replace
from slipstream.bus import Bus
from slipstream.config import BusSettings
from slipstream.messages import SegmentState, decode, state_key
settings = BusSettings.model_validate_json(sys.argv[1])
seconds, pairs = float(sys.argv[2]), json.loads(sys.stdin.read())
state = decode(SegmentState, sys.argv[3].encode(), "argv")
MARK = 1234567890123456789
with Bus.open(settings) as bus:
    outlets = []
    for rsu, segment in pairs:
        mine = replace(state, rsu=rsu, segment=segment, time_ns=MARK)
        before, after = mine.to_bytes().split(str(MARK).encode())
        outlets.append((bus.publisher(state_key(rsu, segment), history=0), before, after))
    print("declared", flush=True)
    began, sent = time.monotonic(), 0
    while (now := time.monotonic()) < began + seconds:
        for _ in range(min(500, int((now - began) * len(pairs)) - sent)):
            publisher, before, after = outlets[sent % len(outlets)]
            publisher.put(before + str(time.time_ns()).encode() + after)
            sent += 1
        time.sleep(0.005)
    print(json.dumps({"sent": sent, "seconds": time.monotonic() - began}), flush=True)
    time.sleep(2.0)
"""


@pytest.mark.nightly
def test_many_rsus_are_all_heard(
    tmp_path: Path, full_size: bool, figure: Callable[[str], None]
) -> None:
    """10,000 states a second from 1,000 RSUs: fresh segments, regular health, no silent loss."""
    rsus, seconds = (1000, 120.0) if full_size else (200, 20.0)
    segments = write_grid(tmp_path / "grid.net.xml", 18)
    watched: dict[str, list[str]] = {
        f"rsu-{n}": [segments[(10 * n + i) % len(segments)] for i in range(10)] for n in range(rsus)
    }
    pairs = [(rsu, segment) for rsu, its in watched.items() for segment in its]
    (tmp_path / "fleet.json").write_text(json.dumps(FLEET))
    settings = {
        "interval_s": 10.0 if full_size else INTERVAL_S,
        "deadline_s": 1.0,
        "solvers": ["exact"],
    }
    shared = {
        "network": str(tmp_path / "grid.net.xml"),
        "fleet": str(tmp_path / "fleet.json"),
        "rsus": {rsu: {"segments": its} for rsu, its in watched.items()},
    }
    cycles, health = Reports(CycleReport), Reports(DispatcherHealth)
    with (
        server(tmp_path, settings, ("dispatcher",), shared) as (port, daemons),
        Bus.open(identity(tmp_path, port, "dashboard")) as bus,
    ):
        bus.subscribe(CYCLE_KEY, cycles.take, every=True)
        bus.subscribe(DISPATCHER_HEALTH_KEY, health.take, every=True)
        cycles.wait_for(1, 120)
        sender = subprocess.Popen(
            [
                sys.executable,
                "-c",
                _RSUS,
                identity(tmp_path, port, "edge-rsu-1").model_dump_json(),
                str(seconds),
                STATE.to_bytes().decode(),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert sender.stdin is not None
            assert sender.stdout is not None
            sender.stdin.write(json.dumps(pairs))
            sender.stdin.close()
            assert sender.stdout.readline() == "declared\n"
            first, beat = len(cycles.got) + 2, len(health.got)
            done = json.loads(sender.stdout.readline())
            last, beats = len(cycles.got), [h.time_ns for h in health.got[beat:]]
        finally:
            sender.kill()
            sender.wait()
            sender.stdout.close()
        outcomes = settled(daemons["dispatcher"])
        judged = daemons["dispatcher"].metric("slipstream_dispatcher_states_total")
    during = cycles.got[first:last]
    fresh = [
        len({gate.segment for gate in report.gates if gate.reason is None}) for report in during
    ]
    everywhere = len({segment for its in watched.values() for segment in its})
    share = sum(number == everywhere for number in fresh) / len(during)
    silent_s = longest_gap_s(beats)
    rate = done["sent"] / done["seconds"]
    figure(f"{rate:.0f} states/s from {rsus} RSUs: {outcomes} of {done['sent']} sent")
    figure(
        f"all segments fresh in {share:.0%} of {len(during)} cycles, health silent {silent_s:.1f} s"
    )
    assert share >= 0.99
    # A host that keeps its processors for others makes it 2.7 to 4.2 s, with the same code.
    assert silent_s < (2.0 if full_size else 10.0)
    assert outcomes["taken"] == judged
    assert 0.5 * done["sent"] < sum(outcomes.values()) <= done["sent"]

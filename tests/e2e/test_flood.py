"""Floods on the bus, against the real router, dispatcher and dashboard."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest
import tomli_w
from prometheus_client.parser import text_string_to_metric_families

from slipstream.bus import Bus, free_port
from slipstream.config import BusSettings
from slipstream.messages import CYCLE_KEY, CycleReport, decode, state_key

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
INTERVAL_S = 4.0

pytestmark = [pytest.mark.attack, pytest.mark.process]

_SENDER = """
import json, sys, time, zenoh
endpoint, key, messages = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
config = zenoh.Config()
for name, value in {
    "mode": "client",
    "connect/endpoints": [endpoint],
    "scouting/multicast/enabled": False,
    "transport/shared_memory/enabled": False,
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


@dataclass
class Cycles:
    """When the dispatcher's cycles began."""

    began_ns: list[int] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def take(self, key: str, payload: bytes) -> None:
        """One report."""
        with self.changed:
            self.began_ns.append(decode(CycleReport, payload, key).started_ns)
            self.changed.notify()

    def wait_for(self, number: int, timeout_s: float = 60.0) -> None:
        """Wait for so many reports."""
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.began_ns) >= number, timeout_s)

    def longest_gap_s(self) -> float:
        """Between two cycles."""
        pairs = zip(self.began_ns, self.began_ns[1:], strict=False)
        return max(1e-9 * (later - earlier) for earlier, later in pairs)


@contextmanager
def started(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    """A Python process that is killed at the end."""
    process = subprocess.Popen([sys.executable, *command])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def server(
    folder: Path, dispatcher: Mapping[str, object]
) -> Iterator[tuple[str, dict[str, Daemon]]]:
    """Router, dispatcher and dashboard of a server; gives the endpoint and the daemons."""
    port, page = free_port(), free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    router = folder / "router.json5"
    router.write_text(
        (DEPLOY / "zenoh" / "router.json5").read_text().replace("127.0.0.1:7447", endpoint[4:])
    )
    commands = {
        "router": (str(DEPLOY / "zenoh" / "router.py"), str(router)),
    }
    ports = {"router": 0}
    for name, settings in {
        "dispatcher": {"database_url": f"sqlite:///{folder / 'slipstream.db'}", **dispatcher},
        "dashboard": {"port": page},
    }.items():
        ports[name] = free_port()
        path = folder / f"{name}.toml"
        path.write_text(
            tomli_w.dumps(
                {
                    **settings,
                    "bus": {"connect": [endpoint]},
                    "service": {"metrics_port": ports[name]},
                }
            )
        )
        commands[name] = ("-m", "slipstream_cli", name, "--config", str(path))
    with ExitStack() as stack:
        yield (
            endpoint,
            {
                name: Daemon(stack.enter_context(started(*command)), ports[name])
                for name, command in commands.items()
            },
        )


@pytest.mark.slow(long=True)
def test_messages_too_large_are_refused_in_bounded_memory(
    tmp_path: Path, full_size: bool, figure: Callable[[str], None]
) -> None:
    """300 messages of 20 MB and one of 900 MB: memory, cycles and what is counted."""
    number, huge = (300, 900_000_000) if full_size else (30, 100_000_000)
    settings = {"interval_s": INTERVAL_S, "deadline_s": 1.0, "solvers": ["exact"]}
    with server(tmp_path, settings) as (endpoint, daemons):
        cycles = Cycles()
        with Bus.open(BusSettings(connect=(endpoint,))) as bus:
            bus.subscribe(CYCLE_KEY, cycles.take, every=True)
            cycles.wait_for(2, 120)
            key = state_key("rsu-1", "avenue_east")
            sent = json.dumps([[number, 20_000_000], [1, huge]])
            with started("-c", _SENDER, endpoint, key, sent) as sender:
                while sender.poll() is None:
                    for daemon in daemons.values():
                        daemon.sample()
                    time.sleep(0.02)
                assert sender.returncode == 0
            cycles.wait_for(len(cycles.began_ns) + 2)
        refused = {
            name: daemons[name].metric("slipstream_bus_samples_total", outcome="oversized")
            for name in ("dispatcher", "dashboard")
        }
    gap = cycles.longest_gap_s() / INTERVAL_S
    peaks = {name: round(daemon.peak_mb) for name, daemon in daemons.items()}
    figure(f"{number} of 20 MB, one of {huge / 1e6:.0f} MB: peaks, MB {peaks}; refused {refused}")
    figure(f"longest gap between cycles {gap:.2f} intervals")
    assert peaks["router"] < 150
    assert peaks["dispatcher"] < 300
    assert peaks["dashboard"] < 250
    assert refused["dispatcher"] >= number
    assert gap <= 1.5

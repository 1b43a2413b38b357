"""The real dispatcher behind a real router, and messages at a rate into it."""

from __future__ import annotations

import json
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

import psutil
import tomli_w
from prometheus_client.parser import text_string_to_metric_families

from slipstream.bus import Router, free_port
from slipstream.site import SHARED

_START_S: Final = 120.0
_SETTLE_S: Final = 30.0


class Metrics:
    """A daemon's metrics page, read once."""

    def __init__(self, port: int) -> None:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=30) as answer:
            text = answer.read().decode()
        self._samples = [
            sample for family in text_string_to_metric_families(text) for sample in family.samples
        ]

    def total(self, name: str, **labels: str) -> float:
        """Sum of the samples that have these labels."""
        return sum(
            sample.value
            for sample in self._samples
            if sample.name == name and labels.items() <= sample.labels.items()
        )

    def buckets(self, name: str) -> dict[float, float]:
        """A histogram's cumulated counts by upper bound."""
        return {
            float(sample.labels["le"]): sample.value
            for sample in self._samples
            if sample.name == f"{name}_bucket"
        }

    def outcomes(self, subscription: str) -> dict[str, int]:
        """The messages in one of the dispatcher's inboxes, by what became of them."""
        return {
            sample.labels["outcome"]: int(sample.value)
            for sample in self._samples
            if sample.name == "slipstream_bus_samples_total"
            and sample.labels["subscription"] == subscription
        }


@contextmanager
def _process(*command: str, **pipes: int) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen([sys.executable, *command], text=True, **pipes) as process:  # type: ignore[call-overload]
        try:
            yield process
        finally:
            process.terminate()


@dataclass(frozen=True)
class Loaded:
    """What a load did. `dispatcher_share`: processor time of the dispatcher while messages came,
    of one core, its cycles included.
    """

    sent: int
    seconds: float
    late_s: float
    message_bytes: float
    before: Metrics
    after: Metrics
    dispatcher_share: float
    router_share: float


@dataclass(frozen=True)
class Cost:
    """Processor time of one message, s."""

    what: str
    bytes: float
    dispatcher_s: float
    router_s: float
    lost: int


def run_load(
    folder: Path, settings: Mapping[str, Any], told: Mapping[str, Any], subscription: str
) -> Loaded:
    """Start router, dispatcher and senders, send for a while, end them.

    Args:
        settings: of the dispatcher, with network, fleet and the segments of each RSU; beside
            database, bus and metrics.
        told: to the senders (see `slipstream_lab.benchmarks.service.senders`), with `seconds`.

    Raises:
        RuntimeError: a process ended, or the dispatcher did not start.
    """
    port = free_port()
    config = folder / "site.toml"
    own = {name: value for name, value in settings.items() if name not in SHARED}
    with Router() as router:
        config.write_text(
            tomli_w.dumps(
                {
                    **{name: value for name, value in settings.items() if name in SHARED},
                    "rsus": {
                        name: {"segments": segments}
                        for name, segments in settings.get("rsus", {}).items()
                    },
                    "dispatcher": own | {"metrics_port": port},
                    "database_url": f"sqlite:///{folder / f'{time.time_ns()}.db'}",
                    "bus": {"connect": [router.endpoint]},
                }
            )
        )
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        with (
            _process("-m", "slipstream_cli", "dispatcher", "--config", str(config)) as dispatcher,
            _process("-m", "slipstream_lab.benchmarks.service.senders", **pipes) as sender,
        ):
            before = _started(dispatcher, port)
            assert sender.stdin is not None
            assert sender.stdout is not None
            sender.stdin.write(json.dumps({"endpoint": router.endpoint, **told}) + "\n")
            sender.stdin.flush()
            _expect(sender.stdout, "declared")
            spent = psutil.Process(dispatcher.pid), psutil.Process()
            began_s, began = time.monotonic(), [_cpu_s(process) for process in spent]
            done = json.loads(_expect(sender.stdout))
            wall_s = time.monotonic() - began_s
            shares = [(_cpu_s(p) - b) / wall_s for p, b in zip(spent, began, strict=True)]
            after = _settled(port, subscription, done["sent"])
            sender.stdin.write("\n")
            sender.stdin.flush()
    return Loaded(
        int(done["sent"]), done["seconds"], done["late_s"], done["bytes"], before, after, *shares
    )


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _expect(stream: IO[str], words: str = "") -> str:
    line = stream.readline()
    if not line.startswith(words or "{"):
        raise RuntimeError(f"the senders ended: {line!r}")
    return line


def _started(dispatcher: subprocess.Popen[str], port: int) -> Metrics:
    """The metrics once the first cycle has ended: from then on all is loaded."""
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline and dispatcher.poll() is None:
        try:
            found = Metrics(port)
        except OSError:
            found = None
        if found is not None and found.total("slipstream_dispatcher_cycles_total"):
            return found
        time.sleep(0.2)
    raise RuntimeError("the dispatcher did not start")


def _settled(port: int, subscription: str, sent: int) -> Metrics:
    """The metrics once all has come, or nothing more comes."""
    deadline, before = time.monotonic() + _SETTLE_S, -1.0
    while True:
        found = Metrics(port)
        now = sum(found.outcomes(subscription).values())
        if now >= sent or now == before or time.monotonic() > deadline:
            return found
        before = now
        time.sleep(1.0)

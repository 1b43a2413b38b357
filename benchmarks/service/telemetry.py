"""Segment states at a rate into the real dispatcher: what is lost, how late, for how much."""

from __future__ import annotations

import json
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Final

import psutil
import tomli_w
from prometheus_client.parser import text_string_to_metric_families

from benchmarks.aims import Check, check_table
from benchmarks.service.grid import write_grid
from slipstream.bus import Router, free_port
from slipstream.messages import ALL_STATES

MAX_LATENCY_S: Final = 0.1
_START_S: Final = 120.0
_SETTLE_S: Final = 30.0
_FLEET: Final = {
    "depots": [{"id": "yard", "node": "0.0"}],
    "vehicles": [{"id": "van-a", "depot": "yard"}],
    "stops": [{"id": "shop", "node": "2.2"}],
}


@dataclass(frozen=True)
class Figures:
    """What was measured.

    Attributes:
        rsus: publishers, each with a session of its own.
        rate: states a second, as sent.
        seconds: for so long.
        sent: states.
        accepted: of them in the traffic table.
        outcomes: of the dispatcher's inbox.
        missed: sequence numbers that the dispatcher missed.
        cpu_share: of one core, all of the dispatcher's process, its cycles included.
        p99_s: upper bound of the 99th percentile, from publication to the traffic table, s; None:
            above the histogram's largest bound.
        within: share of the states that took `MAX_LATENCY_S` at most.
        late_s: how far the senders fell behind their own timetable at worst.
    """

    rsus: int
    rate: float
    seconds: float
    sent: int
    accepted: int
    outcomes: dict[str, int]
    missed: int
    cpu_share: float
    p99_s: float | None
    within: float
    late_s: float

    @property
    def lost(self) -> int:
        """States that did not get to the traffic table."""
        return self.sent - self.accepted

    @property
    def holds(self) -> bool:
        """Whether nothing was lost, in time, on one core."""
        return not self.lost and self.within >= 0.99 and self.cpu_share <= 1.0


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

    def outcomes(self) -> dict[str, int]:
        """The states in the dispatcher's inbox, by what became of them."""
        return {
            sample.labels["outcome"]: int(sample.value)
            for sample in self._samples
            if sample.name == "slipstream_bus_samples_total"
            and sample.labels["subscription"] == ALL_STATES
        }


@contextmanager
def _process(*command: str, **pipes: int) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen([sys.executable, *command], text=True, **pipes) as process:  # type: ignore[call-overload]
        try:
            yield process
        finally:
            process.terminate()


def measure(
    rsus: int, segments_each: int, seconds: float, folder: Path, say: Callable[[str], None]
) -> Figures:
    """Send each segment's state once a second for some time.

    Raises:
        RuntimeError: a process ended, or the dispatcher did not start.
    """
    folder.mkdir(parents=True, exist_ok=True)
    say(f"{rsus} RSUs with {segments_each} segments each, {seconds:.0f} s")
    number = rsus * segments_each
    size = 2
    while 4 * size * (size - 1) < number:
        size += 1
    names = write_grid(folder / "grid.net.xml", size)
    watched = {f"rsu-{n}": names[n * segments_each : (n + 1) * segments_each] for n in range(rsus)}
    (folder / "fleet.json").write_text(json.dumps(_FLEET))
    port = free_port()
    config = folder / "dispatcher.toml"
    with Router() as router:
        config.write_text(
            tomli_w.dumps(
                {
                    "network": str(folder / "grid.net.xml"),
                    "fleet": str(folder / "fleet.json"),
                    "database_url": f"sqlite:///{folder / f'{time.time_ns()}.db'}",
                    "rsus": watched,
                    "bus": {"connect": [router.endpoint]},
                    "service": {"metrics_port": port},
                }
            )
        )
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        with (
            _process("-m", "slipstream_cli", "dispatcher", "--config", str(config)) as dispatcher,
            _process("-m", "benchmarks.service.senders", **pipes) as sender,
        ):
            before = _started(dispatcher, port)
            told = {"endpoint": router.endpoint, "watched": watched, "seconds": seconds}
            assert sender.stdin is not None
            assert sender.stdout is not None
            sender.stdin.write(json.dumps(told) + "\n")
            sender.stdin.flush()
            _expect(sender.stdout, "declared")
            spent = psutil.Process(dispatcher.pid)
            cpu_s, began_s = sum(spent.cpu_times()[:2]), time.monotonic()
            done = json.loads(_expect(sender.stdout))
            cpu_s = sum(spent.cpu_times()[:2]) - cpu_s
            cpu_share = cpu_s / (time.monotonic() - began_s)
            after = _settled(port, done["sent"])
            sender.stdin.write("\n")
            sender.stdin.flush()
    return _figures(rsus, done, before, after, cpu_share)


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


def _settled(port: int, sent: int) -> Metrics:
    """The metrics once all has come, or nothing more comes."""
    deadline, before = time.monotonic() + _SETTLE_S, -1.0
    while True:
        found = Metrics(port)
        now = sum(found.outcomes().values())
        if now >= sent or now == before or time.monotonic() > deadline:
            return found
        before = now
        time.sleep(1.0)


def _figures(
    rsus: int, done: Mapping[str, float], before: Metrics, after: Metrics, cpu_share: float
) -> Figures:
    age = "slipstream_dispatcher_state_age_seconds"
    counts = {
        bound: count - before.buckets(age).get(bound, 0.0)
        for bound, count in after.buckets(age).items()
    }
    total = max(counts.values())
    p99 = next((b for b, count in sorted(counts.items()) if count >= 0.99 * total), None)
    accepted = after.total("slipstream_dispatcher_states_total", verdict="accepted")
    return Figures(
        rsus=rsus,
        rate=done["sent"] / done["seconds"],
        seconds=done["seconds"],
        sent=int(done["sent"]),
        accepted=int(accepted),
        outcomes=after.outcomes(),
        missed=int(after.total("slipstream_dispatcher_rsu_missed")),
        cpu_share=cpu_share,
        p99_s=None if p99 is None or p99 == float("inf") else p99,
        within=counts[MAX_LATENCY_S] / max(total, 1.0),
        late_s=done["late_s"],
    )


def checks(found: Figures) -> list[Check]:
    """The aims."""
    bound = "above 5 s" if found.p99_s is None else f"≤ {1e3 * found.p99_s:.0f} ms"
    return [
        Check(
            f"states lost of {found.sent}, {found.rate:.0f} a second from {found.rsus} RSUs",
            str(found.lost),
            "0",
            found.lost == 0,
        ),
        Check(
            "processor time of the dispatcher, of one core",
            f"{found.cpu_share:.2f}",
            "≤ 1",
            found.cpu_share <= 1.0,
        ),
        Check(
            "publication to traffic table, p99",
            bound,
            f"≤ {1e3 * MAX_LATENCY_S:.0f} ms",
            found.within >= 0.99,
        ),
    ]


def write(
    folder: Path, found: Figures, steps: Sequence[Figures], about: Mapping[str, str]
) -> list[Check]:
    """Write report.md and report.json; returns the aims."""
    aims = checks(found)
    lines = [
        "# Segment states into one dispatcher",
        "",
        *(f"- {name}: {value}" for name, value in about.items()),
        "",
        *check_table(aims),
        "",
        "| states/s | lost | missed | superseded | core | p99, at most | within 100 ms "
        "| senders late |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|",
        *(
            f"| {step.rate:.0f} | {step.lost} | {step.missed} | "
            f"{step.outcomes['superseded']} | "
            f"{step.cpu_share:.2f} | "
            f"{'–' if step.p99_s is None else f'{1e3 * step.p99_s:.0f} ms'} | "
            f"{step.within:.2%} | {step.late_s:.2f} s |"
            for step in steps
        ),
        "",
    ]
    (folder / "report.md").write_text("\n".join(lines), encoding="utf-8")
    report = {"about": dict(about), "steps": [asdict(step) for step in steps]}
    (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return aims

"""Starts the real process with many agents, drives its vehicles over the bus, and measures it."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np
import psutil
import tomli_w

from slipstream.bus import Bus, Router
from slipstream.config import BusSettings
from slipstream.messages import (
    ROOT,
    Message,
    SegmentState,
    VehicleAdvice,
    advice_key,
    decode,
    plan_key,
    sensing_key,
    spat_key,
    state_key,
)
from slipstream_lab.benchmarks.agents.traffic import BenchVan, roadside
from slipstream_lab.benchmarks.aims import Check, at_most, report_head, write_report

_INTERVAL_S: Final = 0.1
_SETTLE_S: Final = 15.0
MAX_ADVICE_MS: Final = 2.0
MAX_ONE_MB: Final = 60.0


@dataclass(frozen=True)
class AgentFigures:
    """What was measured of one process."""

    vans: int
    seconds: float
    cpu_share: float
    advice_ms: float
    latency_ms_p50: float
    latency_ms_p95: float
    advised: float
    rss_mb: float
    modes: Mapping[str, float]


class _Heard:
    """Advice as it arrives."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.sensed_ns: dict[str, int] = {}
        self.clear()

    def clear(self) -> None:
        """Begin to count."""
        with self._lock:
            self.latencies_ms: list[float] = []
            self.modes: Counter[str] = Counter()

    def take(self, key: str, payload: bytes) -> None:
        """An advice."""
        advice = decode(VehicleAdvice, payload, key)
        now_ns = time.time_ns()
        with self._lock:
            self.modes[advice.mode] += 1
            self.latencies_ms.append((now_ns - self.sensed_ns[advice.vehicle]) / 1e6)


def measure(vans: int, seconds: float, folder: Path, say: Callable[[str], None]) -> AgentFigures:
    """Run some agents for some time. Raises RuntimeError: the process ended."""
    folder.mkdir(parents=True, exist_ok=True)
    say(f"{vans} agents, {seconds:.0f} s")
    with Router() as router, Bus.open(BusSettings(connect=(router.endpoint,))) as bus:
        config = folder / f"agents-{vans}.toml"
        config.write_text(
            tomli_w.dumps(
                {
                    "agents": {
                        "all": {
                            "state": str(folder / f"tours-{vans}-{time.time_ns()}"),
                            "vehicles": [{"id": BenchVan(i, 0).name} for i in range(vans)],
                        }
                    },
                    "bus": {"connect": [router.endpoint]},
                }
            )
        )
        heard = _Heard()
        keys = {advice_key(BenchVan(i, 0).name) for i in range(vans)}
        bus.listener("advice", heard.take, every=True).listen(keys)
        command = [sys.executable, "-m", "slipstream_cli", "agent", "--config", str(config)]
        process = subprocess.Popen(command)
        try:
            return _drive(vans, seconds, bus, heard, psutil.Process(process.pid))
        finally:
            process.terminate()
            process.wait(30)


def _drive(
    vans: int, seconds: float, bus: Bus, heard: _Heard, process: psutil.Process
) -> AgentFigures:
    began_ns = time.time_ns()
    all_vans = [BenchVan(i, began_ns) for i in range(vans)]
    outlets = {van.name: bus.publisher(sensing_key(van.name), history=0) for van in all_vans}
    plans = {van.name: bus.publisher(plan_key(van.name)) for van in all_vans}
    for van in all_vans:
        plans[van.name].put(van.plan())
    sensed = sequence = 0
    measured_from = cpu_s = 0.0
    due_s = time.monotonic()
    told_s = 0.0
    while True:
        now_s = time.monotonic()
        if measured_from and now_s - measured_from >= seconds:
            break
        if not measured_from and time.time_ns() - began_ns > _SETTLE_S * 1e9:
            measured_from, cpu_s, sensed = now_s, sum(process.cpu_times()[:2]), 0
            heard.clear()
        if now_s - told_s >= 1.0:
            told_s, sequence = now_s, sequence + 1
            for message in roadside(vans, sequence):
                bus.put(_roadside_key(message), message)
        for van in all_vans:
            now_ns = time.time_ns()
            heard.sensed_ns[van.name] = now_ns
            outlets[van.name].put(van.sensing(now_ns))
            sensed += 1
        due_s += _INTERVAL_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        if not process.is_running():
            raise RuntimeError("the agents' process ended")
    spent_s = sum(process.cpu_times()[:2]) - cpu_s
    elapsed_s = time.monotonic() - measured_from
    latencies = np.array(heard.latencies_ms or [np.inf])
    given = max(1, sum(heard.modes.values()))
    return AgentFigures(
        vans,
        elapsed_s,
        spent_s / elapsed_s,
        1000 * spent_s / given,
        float(np.percentile(latencies, 50)),
        float(np.percentile(latencies, 95)),
        float((latencies <= 1000 * _INTERVAL_S).sum()) / max(1, sensed),
        process.memory_info().rss / 1e6,
        {mode: count / given for mode, count in sorted(heard.modes.items())},
    )


def _roadside_key(message: Message) -> str:
    if isinstance(message, SegmentState):
        return state_key(message.rsu, message.segment)
    return spat_key(getattr(message, "intersection", ROOT))


def checks(one: AgentFigures, many: AgentFigures) -> list[Check]:
    """The aims."""
    return [
        at_most(
            "processor time of an advice, everything counted, ms",
            f"{many.advice_ms:.2f}",
            many.advice_ms,
            MAX_ADVICE_MS,
        ),
        at_most("resident memory of one agent, MB", f"{one.rss_mb:.0f}", one.rss_mb, MAX_ONE_MB),
        Check(
            f"{many.vans} agents: share of one core",
            f"{many.cpu_share:.2f}",
            "≤ 1",
            many.cpu_share <= 1.0,
        ),
        Check(
            f"{many.vans} agents: sensings answered within 0.1 s",
            f"{100 * many.advised:.1f} %",
            "≥ 99 %",
            many.advised >= 0.99,
        ),
    ]


def write(folder: Path, one: AgentFigures, many: AgentFigures, about: Mapping[str, str]) -> None:
    """Write report.md and report.json."""
    lines = report_head("Agents: what they cost", about, checks(one, many))
    lines += ["", *(f"- {figures}" for figures in (one, many)), ""]
    content = {"one": asdict(one), "many": asdict(many)}
    write_report(folder, "\n".join(lines), about, content)

"""The real dashboard fed with a synthetic city over a real router, and two browsers."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import psutil
import tomli_w

from slipstream.bus import Router, free_port
from slipstream_lab.benchmarks.aims import Check, report_head, write_report
from slipstream_lab.benchmarks.dashboard.viewer import StreamViewer, first_paint_s
from slipstream_lab.benchmarks.service.grid import write_grid

MAX_FIRST_S: Final = 1.0
MAX_KB_PER_S: Final = 20.0
MAX_DELAY_S: Final = 1.0
MAX_GROWTH_MB_PER_H: Final = 20.0
_START_S: Final = 180.0
_WARM_UP_S: Final = 8.0


@dataclass(frozen=True)
class ShownCity:
    """What is shown, each road's state and each van's position once a second."""

    roads: int
    vans: int
    rsus: int
    max_cpu_share: float


@dataclass(frozen=True)
class DashboardFigures:
    """What was measured. `first_paint_s`: to Chromium's first content, s; None: there is no
    Chromium.
    """

    city: ShownCity
    seconds: float
    first_moment_s: float
    first_paint_s: float | None
    kb_per_s: float
    events_per_s: float
    cpu_share: float
    delays_s: tuple[float, ...]
    probes: int
    rss_mb: tuple[float, float]

    def delay_s(self, share: float) -> float:
        """A quantile of the delays, s."""
        return self.delays_s[min(len(self.delays_s) - 1, int(share * len(self.delays_s)))]

    @property
    def growth_mb_per_h(self) -> float:
        """Of the resident memory."""
        return (self.rss_mb[1] - self.rss_mb[0]) * 3600 / self.seconds


def measure(
    city: ShownCity, seconds: float, folder: Path, say: Callable[[str], None]
) -> DashboardFigures:
    """Show a city for some time. Raises RuntimeError: a process ended, or the dashboard did not
    start.
    """
    folder.mkdir(parents=True, exist_ok=True)
    say(f"{city.roads} roads, {city.vans} vans, {city.rsus} RSUs, {seconds:.0f} s")
    size = 2
    while 4 * size * (size - 1) < city.roads:
        size += 1
    names = write_grid(folder / "grid.net.xml", size)[: city.roads]
    each = -(-city.roads // city.rsus)
    watched = {f"rsu-{n}": names[n * each : (n + 1) * each] for n in range(city.rsus)}
    port, config = free_port(), folder / "dashboard.toml"
    with Router() as router:
        settings = {
            "network": str(folder / "grid.net.xml"),
            "rsus": {name: {"segments": segments} for name, segments in watched.items()},
            "bus": {"connect": [router.endpoint]},
            "dashboard": {"port": port, "scene_port": free_port()},
            "database_url": f"sqlite:///{folder / 'none.db'}",
        }
        config.write_text(tomli_w.dumps(settings))
        command = [sys.executable, "-m"]
        daemon = subprocess.Popen(
            [*command, "slipstream_cli", "dashboard", "--config", str(config)]
        )
        sender = subprocess.Popen(
            [*command, "slipstream_lab.benchmarks.dashboard.city"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            _await_served(daemon, port)
            assert sender.stdin is not None
            told = {"endpoint": router.endpoint, "network": settings["network"], "vans": city.vans}
            sender.stdin.write(json.dumps(told | {"watched": watched}) + "\n")
            sender.stdin.flush()
            return _watch(city, seconds, port, daemon, sender, names[0])
        finally:
            for process in (daemon, sender):
                process.kill()
                process.wait()


def _watch(
    city: ShownCity,
    seconds: float,
    port: int,
    daemon: subprocess.Popen[Any],
    sender: subprocess.Popen[str],
    probe: str,
) -> DashboardFigures:
    assert sender.stdout is not None
    if sender.stdout.readline().strip() != "declared":
        raise RuntimeError("the senders ended")
    sent: dict[int, float] = {}

    def note() -> None:
        for line in sender.stdout or ():
            one = json.loads(line)
            sent[one["probe"]] = one["at"]

    threading.Thread(target=note, daemon=True).start()
    time.sleep(_WARM_UP_S)
    viewers = [StreamViewer(port, probe) for _ in range(2)]
    for viewer in viewers:
        viewer.start()
    deadline = time.monotonic() + 60
    while any(viewer.first_s is None for viewer in viewers):
        if time.monotonic() > deadline or daemon.poll() is not None:
            raise RuntimeError("no moment came")
        time.sleep(0.05)
    time.sleep(_WARM_UP_S)
    process = psutil.Process(daemon.pid)
    begun, cpu_s = time.monotonic(), sum(process.cpu_times()[:2])
    rss_mb = process.memory_info().rss / 1e6
    before = [(viewer.received, viewer.events) for viewer in viewers]
    time.sleep(seconds)
    took_s = time.monotonic() - begun
    cpu_share = (sum(process.cpu_times()[:2]) - cpu_s) / took_s
    after = [(viewer.received, viewer.events) for viewer in viewers]
    end_mb = process.memory_info().rss / 1e6
    delays = sorted(
        viewer.seen[number] - at
        for viewer in viewers
        for number, at in list(sent.items())
        if number in viewer.seen
    )
    if not delays:
        raise RuntimeError("no state of the probe was shown")
    return DashboardFigures(
        city=city,
        seconds=took_s,
        first_moment_s=max(viewer.first_s or 0.0 for viewer in viewers),
        first_paint_s=first_paint_s(f"http://127.0.0.1:{port}/"),
        kb_per_s=max((a[0] - b[0]) / took_s / 1e3 for a, b in zip(after, before, strict=True)),
        events_per_s=max((a[1] - b[1]) / took_s for a, b in zip(after, before, strict=True)),
        cpu_share=cpu_share,
        delays_s=tuple(delays),
        probes=len(sent),
        rss_mb=(rss_mb, end_mb),
    )


def _await_served(daemon: subprocess.Popen[Any], port: int) -> None:
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline and daemon.poll() is None:
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{port}/api/config", timeout=10).close()
            return
        except OSError:
            time.sleep(0.2)
    raise RuntimeError("the dashboard did not start")


def checks(found: DashboardFigures, *, memory: bool) -> list[Check]:
    """The aims of one city; memory only after a run that is long enough to tell."""
    city = found.city
    what = f"{city.roads} roads, {city.vans} vans"
    kept = found.growth_mb_per_h <= MAX_GROWTH_MB_PER_H if memory else None
    paint = found.first_paint_s
    return [
        Check(
            f"{what}: request to the first moment",
            f"{found.first_moment_s:.2f} s",
            f"≤ {MAX_FIRST_S:g} s",
            found.first_moment_s <= MAX_FIRST_S,
        ),
        Check(
            f"{what}: first content in Chromium",
            "–" if paint is None else f"{paint:.2f} s",
            f"≤ {MAX_FIRST_S:g} s",
            None if paint is None else paint <= MAX_FIRST_S,
        ),
        Check(
            f"{what}: to each of two browsers",
            f"{found.kb_per_s:.1f} kB/s",
            f"≤ {MAX_KB_PER_S:g} kB/s" if city.roads <= 1000 else "–",
            found.kb_per_s <= MAX_KB_PER_S if city.roads <= 1000 else None,
        ),
        Check(
            f"{what}: processor time of the dashboard, of one core",
            f"{found.cpu_share:.1%}",
            f"≤ {city.max_cpu_share:.0%}",
            found.cpu_share <= city.max_cpu_share,
        ),
        Check(
            f"{what}: message to browser, p95",
            f"{found.delay_s(0.95):.2f} s",
            f"≤ {MAX_DELAY_S:g} s",
            found.delay_s(0.95) <= MAX_DELAY_S,
        ),
        Check(
            f"{what}: memory, an hour",
            f"{found.growth_mb_per_h:+.1f} MB",
            f"≤ {MAX_GROWTH_MB_PER_H:g} MB",
            kept,
        ),
    ]


def write(
    folder: Path,
    figures: Sequence[DashboardFigures],
    aims: Sequence[Check],
    about: Mapping[str, str],
) -> None:
    """Write report.md and report.json."""
    lines = [
        *report_head("The operator's page", about, aims),
        "",
        "| roads | s | events/s | delay p50 | p95 | max | probes | memory, MB |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|",
        *(
            f"| {one.city.roads} | {one.seconds:.0f} | {one.events_per_s:.2f} | "
            f"{one.delay_s(0.5):.2f} | {one.delay_s(0.95):.2f} | {one.delays_s[-1]:.2f} | "
            f"{one.probes} | {one.rss_mb[0]:.0f} → {one.rss_mb[1]:.0f} |"
            for one in figures
        ),
        "",
    ]
    content = {"cities": [asdict(one) for one in figures]}
    write_report(folder, "\n".join(lines), about, content)

"""Runs the background traffic of a day in a subprocess and returns its record."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from edge_daemon.settings import StabilitySettings
from slipstream_lab.simulation.rsus import Rsu
from slipstream_lab.simulation.scenarios.gridlock import CHECK_S, GridlockWatch
from slipstream_lab.simulation.scenarios.record import (
    SimulatedDay,
    hours_of,
    read_statistics,
    read_traffic,
    read_trips,
)
from slipstream_lab.simulation.sumo import Progress, check_files, run_in_subprocess

if TYPE_CHECKING:
    from slipstream_lab.simulation.scenarios.perception import Observation, Observer


@dataclass(frozen=True)
class DaySpec:
    """What to simulate.

    Attributes:
        begin_s: simulated time; vehicles due earlier are left out.
        step_s: of the simulation; a window and a second must be multiples of it.
        rule: of the true stability of windows: the paper's, without doubt.
    """

    net: Path
    routes: tuple[Path, ...]
    segments: tuple[str, ...]
    additional: tuple[Path, ...] = ()
    rsus: tuple[Rsu, ...] = ()
    begin_s: float = 0.0
    end_s: float = 86400.0
    step_s: float = 1.0
    interval_s: float = 300.0
    window_every_s: float = 300.0
    window_s: float = 10.0
    seed: int = 1
    rule: StabilitySettings = field(default_factory=lambda: StabilitySettings().bare())

    @property
    def files(self) -> tuple[Path, ...]:
        """All SUMO files, the net first."""
        return (self.net, *self.routes, *self.additional)

    @property
    def source(self) -> str:
        """Net and routes, for errors."""
        return ", ".join(path.name for path in (self.net, *self.routes))


def sumo_options(spec: DaySpec, additional: tuple[Path, ...] = ()) -> list[str]:
    """SUMO's options for a day, the same for every arm."""
    files = (*spec.additional, *additional)
    return [
        *("--net-file", str(spec.net), "--route-files", ",".join(map(str, spec.routes))),
        *(("--additional-files", ",".join(map(str, files))) if files else ()),
        *("--begin", f"{spec.begin_s:g}", "--end", f"{spec.end_s:g}"),
        *("--step-length", f"{spec.step_s:g}", "--seed", str(spec.seed)),
        *("--xml-validation", "never", "--no-step-log", "true", "--no-warnings", "true"),
        *("--duration-log.disable", "true"),
    ]


def run_day(spec: DaySpec, progress: Progress | None = None) -> SimulatedDay:
    """Simulate in another process.

    Raises:
        InputError: a file is no SUMO file or none that fits the net, or SUMO dies of it.
        ModuleNotFoundError: libsumo is not installed.
    """
    check_files(spec.net, spec.files[1:])
    return run_in_subprocess(simulate, spec, spec.source, spec.end_s, progress)


def simulate(spec: DaySpec, report_time: Callable[[float], None]) -> SimulatedDay:
    """Simulate in this process. Raises InputError: SUMO refuses a file."""
    from slipstream_lab.simulation.sumo.session import SumoSession

    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        edges, trips, statistics = (folder / f"{n}.xml" for n in ("edges", "trips", "statistics"))
        tables = folder / "tables.add.xml"
        tables.write_text(
            f'<additional><edgeData id="traffic" file="{edges}" period="{spec.interval_s:g}" '
            f'begin="{spec.begin_s:g}" excludeEmpty="true" '
            'writeAttributes="sampledSeconds speed waitingTime entered departed"/></additional>\n'
        )
        options = [
            *sumo_options(spec, (tables,)),
            *("--tripinfo-output", str(trips), "--statistic-output", str(statistics)),
        ]
        watch = _Watch(spec, report_time)
        with SumoSession(options, spec.files) as session:
            end_s = watch.run(session.advance)
        ended = read_trips(trips)
        traffic = read_traffic(edges, spec.segments, spec.begin_s, end_s, spec.interval_s)
        return SimulatedDay(
            spec.begin_s,
            end_s,
            read_statistics(statistics, ended),
            traffic,
            hours_of(traffic, ended, end_s, watch.observations, spec.rule.min_vehicles),
            tuple(watch.observations),
            watch.gridlock_s,
            time.monotonic() - began,
        )


class _Watch:
    """Advances the simulation from window to window, and checks for a gridlock."""

    def __init__(self, spec: DaySpec, report_time: Callable[[float], None]) -> None:
        self._spec = spec
        self._report_time = report_time
        self._gridlock = GridlockWatch()
        self._observer: Observer | None = None
        self.observations: list[Observation] = []
        if spec.rsus:
            # Imported here: the edge's parts cost a second, which a day without RSUs need not pay.
            from slipstream_lab.simulation.scenarios.perception import Observer

            window_s = min(spec.window_s, spec.window_every_s)
            self._observer = Observer(spec.rsus, spec.step_s, spec.rule, window_s)

    @property
    def gridlock_s(self) -> float | None:
        """When most vehicles had stood for long; None: never."""
        return self._gridlock.since_s

    def run(self, advance: Callable[[float], None]) -> float:
        """Go to the end, or to a gridlock; returns the simulated time there, s."""
        spec = self._spec
        window_s = min(spec.window_s, spec.window_every_s)
        now, check_s = spec.begin_s, spec.begin_s + CHECK_S
        while now < spec.end_s:
            if self._observer is not None:
                due = (now // spec.window_every_s + 1) * spec.window_every_s
                if due <= spec.end_s:
                    self._window(self._observer, advance, due, window_s)
                else:
                    due = spec.end_s
                    advance(due)
            else:
                due = min(check_s, spec.end_s)
                advance(due)
            now = due
            if now >= check_s:
                check_s += CHECK_S
                self._report_time(now)
                if self._gridlock.update(now):
                    break
        return now

    def _window(
        self, observer: Observer, advance: Callable[[float], None], due_s: float, window_s: float
    ) -> None:
        spec = self._spec
        steps = round(window_s / spec.step_s)
        if due_s - window_s > spec.begin_s:
            advance(due_s - window_s)
        observer.forget()
        for step in range(steps, 0, -1):
            at = due_s - (step - 1) * spec.step_s
            if at > spec.begin_s:
                advance(at)
            observer.sample()
        self.observations.extend(observer.observe(due_s))

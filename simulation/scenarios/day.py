"""Runs the background traffic of a day in a process of its own and brings back its record."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from edge_daemon.stability import StabilitySettings
from simulation.scenarios.gridlock import CHECK_S, GridlockWatch
from simulation.scenarios.perception import Rsu
from simulation.scenarios.record import (
    Day,
    hours_of,
    read_statistics,
    read_traffic,
    read_trips,
)
from simulation.sumo import Progress, check_files, run_apart

if TYPE_CHECKING:
    from simulation.scenarios.perception import Observation, Observer


@dataclass(frozen=True)
class DayOrder:
    """What to simulate.

    Attributes:
        net: a SUMO net.
        routes: its route file.
        segments: of the network, in the order of the record's tables.
        additional: further SUMO files, as another signal program.
        rsus: whose windows are recorded.
        begin_s: simulated time; vehicles due earlier are left out.
        end_s: simulated time.
        step_s: of the simulation; a window and a second must be multiples of it.
        interval_s: of the traffic tables; divides an hour.
        window_every_s: a window of the RSUs ends at each multiple.
        window_s: its length, no more than that.
        seed: of SUMO. With the scenarios' own vehicles nothing is drawn from it.
        rule: by which windows are stable in truth: the paper's, without hysteresis.
    """

    net: Path
    routes: Path
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


def sumo_options(order: DayOrder, additional: tuple[Path, ...] = ()) -> list[str]:
    """SUMO's options for a day, the same for every arm: what its vehicles do hangs on them."""
    files = (*order.additional, *additional)
    return [
        *("--net-file", str(order.net), "--route-files", str(order.routes)),
        *(("--additional-files", ",".join(map(str, files))) if files else ()),
        *("--begin", f"{order.begin_s:g}", "--end", f"{order.end_s:g}"),
        *("--step-length", f"{order.step_s:g}", "--seed", str(order.seed)),
        *("--xml-validation", "never", "--no-step-log", "true", "--no-warnings", "true"),
        *("--duration-log.disable", "true"),
    ]


def run_day(order: DayOrder, progress: Progress | None = None) -> Day:
    """Simulate in another process.

    Raises:
        InputError: a file is no SUMO file or none that fits the net, or SUMO dies of it.
        ModuleNotFoundError: libsumo is not installed.
    """
    check_files(order.net, (order.routes, *order.additional))
    source = f"{order.net.name}, {order.routes.name}"
    return run_apart(simulate, order, source, order.end_s, progress)


def simulate(order: DayOrder, tell: Callable[[float], None]) -> Day:
    """Simulate in this process.

    Args:
        tell: told the simulated time now and then.

    Raises:
        InputError: SUMO refuses a file.
    """
    from simulation.sumo.session import Session

    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        edges, trips, statistics = (folder / f"{n}.xml" for n in ("edges", "trips", "statistics"))
        tables = folder / "tables.add.xml"
        tables.write_text(
            f'<additional><edgeData id="traffic" file="{edges}" period="{order.interval_s:g}" '
            f'begin="{order.begin_s:g}" excludeEmpty="true" '
            'writeAttributes="sampledSeconds speed waitingTime entered departed"/></additional>\n'
        )
        options = [
            *sumo_options(order, (tables,)),
            *("--tripinfo-output", str(trips), "--statistic-output", str(statistics)),
        ]
        watch = _Watch(order, tell)
        with Session(options, (order.net, order.routes, *order.additional)) as session:
            end_s = watch.run(session.advance)
        ended = read_trips(trips)
        traffic = read_traffic(edges, order.segments, order.begin_s, end_s, order.interval_s)
        return Day(
            order.begin_s,
            end_s,
            read_statistics(statistics, ended),
            traffic,
            hours_of(traffic, ended, end_s, watch.observations, order.rule.min_vehicles),
            tuple(watch.observations),
            watch.gridlock_s,
            time.monotonic() - began,
        )


class _Watch:
    """Drives the simulation from window to window and looks for a gridlock on the way."""

    def __init__(self, order: DayOrder, tell: Callable[[float], None]) -> None:
        self._order = order
        self._tell = tell
        self._gridlock = GridlockWatch()
        self._observer: Observer | None = None
        self.observations: list[Observation] = []
        if order.rsus:
            # Imported here: the edge's parts cost a second, which a day without RSUs need not pay.
            from simulation.scenarios.perception import Observer

            window_s = min(order.window_s, order.window_every_s)
            self._observer = Observer(order.rsus, order.step_s, order.rule, window_s)

    @property
    def gridlock_s(self) -> float | None:
        """When most vehicles had stood for long; None: never."""
        return self._gridlock.since_s

    def run(self, advance: Callable[[float], None]) -> float:
        """Go to the end, or to a gridlock; returns the simulated time there, s."""
        order = self._order
        window_s = min(order.window_s, order.window_every_s)
        now, check_s = order.begin_s, order.begin_s + CHECK_S
        while now < order.end_s:
            if self._observer is not None:
                due = (now // order.window_every_s + 1) * order.window_every_s
                if due <= order.end_s:
                    self._window(self._observer, advance, due, window_s)
                else:
                    due = order.end_s
                    advance(due)
            else:
                due = min(check_s, order.end_s)
                advance(due)
            now = due
            if now >= check_s:
                check_s += CHECK_S
                self._tell(now)
                if self._gridlock.look(now):
                    break
        return now

    def _window(
        self, observer: Observer, advance: Callable[[float], None], due_s: float, window_s: float
    ) -> None:
        order = self._order
        steps = round(window_s / order.step_s)
        if due_s - window_s > order.begin_s:
            advance(due_s - window_s)
        observer.forget()
        for step in range(steps, 0, -1):
            at = due_s - (step - 1) * order.step_s
            if at > order.begin_s:
                advance(at)
            observer.look()
        self.observations.extend(observer.observe(due_s))

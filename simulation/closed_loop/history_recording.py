"""Records a `History`: another day's background is driven, and every passage counted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Final

import numpy as np

from simulation.closed_loop.history import HOURS, Array, History
from simulation.scenarios.day import DaySpec, sumo_options
from simulation.scenarios.gridlock import CHECK_S, GridlockWatch
from simulation.scenarios.scenario import Scenario, SignalControl, day_spec, prepare
from simulation.sumo import Progress, check_files, run_in_subprocess
from slipstream.drive import DrivingStyle
from slipstream.energy import PAPER_CAR, wheel_power_w
from slipstream.roads import RoadNetwork

OTHER_DAY: Final = 1000
"""Added to a day's seed for the day that its history is of: the same town, other trips."""

_CLASSES: Final = frozenset({"passenger", "delivery"})
"""Vehicles whose speeds a car could have driven."""
_STANDING_MPS: Final = 0.1
_AT_ONCE: Final = 256
_HOUR_S: Final = 3600.0


@dataclass(frozen=True)
class HistorySpec:
    """What to record: a day, and the limits of its roads, m/s, by segment."""

    day: DaySpec
    limits_mps: Mapping[str, float]


def history_of(
    scenario: Scenario,
    seed: int,
    folder: Path,
    *,
    signals: SignalControl = "actuated",
    begin_s: float = 0.0,
    end_s: float = 86400.0,
    progress: Progress | None = None,
) -> Path:
    """File with the history for days of a seed, or hours of them, recorded unless it is there.

    Its day has another seed, `seed + OTHER_DAY`, so nothing in it is known beforehand.

    Raises:
        InputError: SUMO refuses the day, or it ends in a gridlock.
    """
    path = history_file(
        folder,
        f"{scenario.name}-{seed}",
        signals,
        (begin_s, end_s),
        (scenario.net.read_bytes(), scenario.demand.digest_text().encode()),
    )
    if not path.exists():
        background = prepare(scenario, seed + OTHER_DAY, folder)
        day = day_spec(scenario, background, folder, signals=signals, begin_s=begin_s, end_s=end_s)
        record_history(day, scenario.network, progress).save(path)
    return path


def history_file(
    folder: Path,
    name: str,
    signals: SignalControl,
    span_s: tuple[float, float],
    depends_on: Iterable[bytes],
) -> Path:
    """Where a history lies: another net or other traffic has another name.

    Args:
        name: of the scenario and what its traffic is of.
        span_s: begin and end of what was recorded, s since midnight.
        depends_on: contents of the net and of what the traffic is made from.
    """
    begin_s, end_s = span_s
    hours = "" if end_s - begin_s >= 86400 else f"-{begin_s:.0f}-{end_s:.0f}"
    digest = sha256()
    for part in depends_on:
        digest.update(sha256(part).digest())
    return folder / f"{name}-{signals}{hours}-{digest.hexdigest()[:8]}-history.json"


def record_history(day: DaySpec, network: RoadNetwork, progress: Progress | None = None) -> History:
    """Drive a day's background in a subprocess.

    Raises:
        InputError: a file is no SUMO file or none that fits the net, SUMO dies of it, or the day
            ends in a gridlock.
        ModuleNotFoundError: libsumo is not installed.
    """
    check_files(day.net, (day.routes, *day.additional))
    limits = {name: segment.speed_limit_mps for name, segment in network.segments.items()}
    source = f"{day.net.name}, {day.routes.name}"
    return run_in_subprocess(_simulate, HistorySpec(day, limits), source, day.end_s, progress)


def _simulate(spec: HistorySpec, report_time: Callable[[float], None]) -> History:
    from simulation.sumo.session import Session

    day = spec.day
    passages = Passages(spec.limits_mps, day.step_s)
    gridlock = GridlockWatch()
    with Session(sumo_options(day), (day.net, day.routes, *day.additional)) as session:
        traces: dict[str, Trace | None] = {}
        finished: list[Trace] = []
        while (now_s := session.time_s) < day.end_s:
            if now_s % CHECK_S == 0 and now_s > day.begin_s:
                report_time(now_s)
                gridlock.refuse(now_s, day.routes)
            session.advance()
            finished += _sample(traces, session.time_s)
            if len(finished) >= _AT_ONCE:
                passages.count(finished)
                finished = []
        passages.count([*finished, *(trace for trace in traces.values() if trace is not None)])
    return passages.history()


@dataclass
class Trace:
    """One vehicle's drive: speeds at the steps, and at which of them it came onto which segment of
    its route; the first entry is where it came onto the road.
    """

    begin_s: float
    route: Sequence[str]
    speeds_mps: list[float] = field(default_factory=list)
    entries: list[tuple[int, int]] = field(default_factory=list)


def _sample(traces: dict[str, Trace | None], now_s: float) -> list[Trace]:
    """Add the running simulation's present step; the traces that have ended."""
    import libsumo

    vehicle = libsumo.vehicle
    speed, index = vehicle.getSpeed, vehicle.getRouteIndex
    ended = [traces.pop(name, None) for name in libsumo.simulation.getArrivedIDList()]
    for name in vehicle.getIDList():
        try:
            trace = traces[name]
        except KeyError:
            counts = vehicle.getVehicleClass(name) in _CLASSES
            trace = traces[name] = Trace(now_s, vehicle.getRoute(name)) if counts else None
        if trace is None:
            continue
        number = index(name)
        if not trace.entries or trace.entries[-1][1] != number:
            trace.entries.append((len(trace.speeds_mps), number))
        trace.speeds_mps.append(speed(name))
    return [trace for trace in ended if trace is not None]


class Passages:
    """Sums up passages of movements.

    Args:
        limits_mps: of each segment.
        step_s: between a trace's speeds.
        style: gaining speed by which time is put down to the movement that lost it.
    """

    def __init__(
        self, limits_mps: Mapping[str, float], step_s: float, style: DrivingStyle | None = None
    ) -> None:
        self._limits, self._step_s = limits_mps, step_s
        self._gain_mps2 = (style or DrivingStyle()).acceleration_mps2
        self._row: dict[tuple[str, str], int] = {}
        self._tables: list[tuple[Array, Array]] = []

    def count(self, traces: Sequence[Trace]) -> None:
        """Count the whole passages of some traces: from entering a segment to entering the next."""
        rows, cells = [], []
        offset = 0
        for trace in traces:
            for (i, a), (j, b) in zip(trace.entries[1:], trace.entries[2:], strict=False):
                if b == a + 1:
                    pair = trace.route[a], trace.route[b]
                    hour = int((trace.begin_s + i * self._step_s) // _HOUR_S) % HOURS
                    rows.append(
                        (offset + i, offset + j, self._limit(pair[0]), self._limit(pair[1]))
                    )
                    cells.append(self._row.setdefault(pair, len(self._row)) * HOURS + hour)
            offset += len(trace.speeds_mps)
        if not rows:
            return
        loss, stops = self._along(traces)
        begin, end = np.array([(i, j) for i, j, _, _ in rows]).T
        speeds = np.concatenate([trace.speeds_mps for trace in traces])
        limits = np.array([(a, b) for _, _, a, b in rows])
        late = self._behind_s(speeds[end], limits[:, 1]) - self._behind_s(
            speeds[begin], limits[:, 0]
        )
        sums = np.stack(
            [
                np.ones(len(rows)),
                loss[end] - loss[begin],
                (end - begin) * self._step_s + late,
                stops[end] - stops[begin],
            ]
        )
        self._tables.append((np.array(cells), sums))

    def _limit(self, segment: str) -> float:
        return self._limits.get(segment, 0.0)

    def _behind_s(self, speed_mps: Array, limit_mps: Array) -> Array:
        """Time that will be lost in gaining the limit's speed, s: (v_limit − v)²/2a v_limit."""
        below = np.maximum(limit_mps - speed_mps, 0.0)
        return np.asarray(below**2 / (2 * self._gain_mps2 * np.maximum(limit_mps, 1e-9)))

    def _along(self, traces: Sequence[Trace]) -> tuple[Array, Array]:
        """Energy lost, kWh, and stops, up to each step of the traces laid end to end."""
        speeds = np.concatenate([trace.speeds_mps for trace in traces])
        v0, v1 = speeds[:-1], speeds[1:]
        power = wheel_power_w(0.5 * (v0 + v1), (v1 - v0) / self._step_s)
        kinetic = 0.5 * PAPER_CAR.mass_kg * (v1**2 - v0**2)
        loss = PAPER_CAR.electrical_kwh(1.0) * (power * self._step_s - kinetic)
        stops = (v1 < _STANDING_MPS) & (v0 >= _STANDING_MPS)
        # Between the end of one trace and the begin of the next nothing is driven.
        ends = np.cumsum([len(trace.speeds_mps) for trace in traces])[:-1] - 1
        loss[ends], stops[ends] = 0.0, False
        return np.append(0.0, np.cumsum(loss)), np.append(0.0, np.cumsum(stops))

    def history(self) -> History:
        """What was counted."""
        table = np.zeros((4, len(self._row) * HOURS))
        for cells, sums in self._tables:
            for total, values in zip(table, sums, strict=True):
                total += np.bincount(cells, weights=values, minlength=table.shape[1])
        spec = sorted(self._row)
        rows = [self._row[pair] for pair in spec]
        return History(tuple(spec), *table.reshape(4, -1, HOURS)[:, rows])

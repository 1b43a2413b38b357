"""Records a `History`: another day's background is driven, and every passage counted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

from dispatcher_daemon.fleet.learning import DrivenTrace, History, Passages
from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.closed_loop.history_file import save_history
from slipstream_lab.simulation.scenarios.day import DaySpec, sumo_options
from slipstream_lab.simulation.scenarios.gridlock import CHECK_S, GridlockWatch
from slipstream_lab.simulation.scenarios.scenario import Scenario, SignalControl, day_spec, prepare
from slipstream_lab.simulation.sumo import Progress, check_files, run_in_subprocess

OTHER_DAY: Final = 1000
"""Added to a day's seed for the day that its history is of: the same town, other trips."""

_CLASSES: Final = frozenset({"passenger", "delivery"})
"""Vehicles whose speeds a car could have driven."""
_AT_ONCE: Final = 256


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
        (
            scenario.net.read_bytes(),
            scenario.demand.digest_text().encode(),
            *(path.read_bytes() for path in scenario.additional),
        ),
    )
    if not path.exists():
        background = prepare(scenario, seed + OTHER_DAY, folder)
        day = day_spec(scenario, background, folder, signals=signals, begin_s=begin_s, end_s=end_s)
        save_history(record_history(day, scenario.network, progress), path)
    return path


def history_file(
    folder: Path,
    name: str,
    signals: SignalControl,
    span_s: tuple[float, float],
    depends_on: Iterable[bytes],
) -> Path:
    """Where a history lies: another net or other traffic has another name."""
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
    check_files(day.net, day.files[1:])
    limits = {name: segment.speed_limit_mps for name, segment in network.segments.items()}
    return run_in_subprocess(_simulate, HistorySpec(day, limits), day.source, day.end_s, progress)


def _simulate(spec: HistorySpec, report_time: Callable[[float], None]) -> History:
    from slipstream_lab.simulation.sumo.session import SumoSession

    day = spec.day
    passages = Passages(spec.limits_mps, day.step_s)
    gridlock = GridlockWatch()
    with SumoSession(sumo_options(day), day.files) as session:
        traces: dict[str, DrivenTrace | None] = {}
        finished: list[DrivenTrace] = []
        while (now_s := session.time_s) < day.end_s:
            if now_s % CHECK_S == 0 and now_s > day.begin_s:
                report_time(now_s)
                gridlock.refuse(now_s, day.source)
            session.advance()
            finished += _sample(traces, session.time_s)
            if len(finished) >= _AT_ONCE:
                passages.count(finished)
                finished = []
        passages.count([*finished, *(trace for trace in traces.values() if trace is not None)])
    return passages.history()


def _sample(traces: dict[str, DrivenTrace | None], now_s: float) -> list[DrivenTrace]:
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
            trace = traces[name] = DrivenTrace(now_s, vehicle.getRoute(name)) if counts else None
        if trace is None:
            continue
        number = index(name)
        if not trace.entries or trace.entries[-1][1] != number:
            trace.entries.append((len(trace.speeds_mps), number))
        trace.speeds_mps.append(speed(name))
    return [trace for trace in ended if trace is not None]

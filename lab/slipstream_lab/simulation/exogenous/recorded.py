"""A recorded background day in a file: the input of an exogenous evaluation."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Final, Literal
from zipfile import BadZipFile

import numpy as np

from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.fleet.safety import MAX_TELEPORTED
from slipstream_lab.simulation.ground_truth import TrueWindow
from slipstream_lab.simulation.rsus import Rsu, WatchedStretch
from slipstream_lab.simulation.scenarios.acceptance import AcceptanceLimits
from slipstream_lab.simulation.scenarios.day import DaySpec, run_day
from slipstream_lab.simulation.scenarios.demand import Array
from slipstream_lab.simulation.scenarios.perception import Observation
from slipstream_lab.simulation.scenarios.record import Traffic
from slipstream_lab.simulation.scenarios.scenario import (
    BackgroundTraffic,
    Scenario,
    SignalControl,
    day_spec,
)
from slipstream_lab.simulation.sumo import Progress

Watched = Literal["rsus", "everywhere"]
"""Where traffic is judged: on the segments that the scenario's RSUs watch, or on every segment that
is long enough to be watched, as if the city were full of RSUs."""

WINDOW_S: Final = 60.0
"""Length of the windows that traffic is judged by."""
_EVERY_S: Final[dict[Watched, float]] = {"rsus": 60.0, "everywhere": 300.0}
_WINDOW_FIELDS: Final = tuple(field.name for field in fields(TrueWindow))


@dataclass(frozen=True)
class RecordedTraffic:
    """A background day that nothing changes any more."""

    traffic: Traffic
    observations: tuple[Observation, ...]
    every_s: float

    @property
    def end_s(self) -> float:
        """Where the record ends, s since midnight."""
        return self.traffic.begin_s + self.traffic.interval_s * len(self.traffic.present_s)


def record_background(
    scenario: Scenario,
    background: BackgroundTraffic,
    folder: Path,
    *,
    watched: Watched = "rsus",
    signals: SignalControl = "actuated",
    begin_s: float = 0.0,
    end_s: float = 86400.0,
    progress: Progress | None = None,
) -> RecordedTraffic:
    """Simulate a day's background, or read what an earlier call left in the folder.

    Windows are a minute long, so that roads with few vehicles can be judged too. RSUs report each
    minute, an everywhere of them, for its size, once in each interval of traffic.

    Args:
        folder: for the record; one of another net, route file or time is replaced.

    Raises:
        InputError: SUMO refuses a file, or the day is refused (see `scenarios.acceptance`).
    """
    if watched == "everywhere":
        background = replace(background, rsus=rsus_everywhere(scenario.network))
    spec = replace(
        day_spec(scenario, background, folder, signals=signals, begin_s=begin_s, end_s=end_s),
        window_every_s=_EVERY_S[watched],
        window_s=WINDOW_S,
    )
    hours = f"{begin_s / 3600:g}-{end_s / 3600:g}"
    path = folder / f"{background.files[0].name.partition('.')[0]}-{watched}-{signals}-{hours}.npz"
    key = _fingerprint(spec)
    found = _read(path, key)
    if found is None:
        day = run_day(spec, progress)
        AcceptanceLimits(incidents=MAX_TELEPORTED).check(day, spec.source)
        found = RecordedTraffic(day.traffic, day.observations, spec.window_every_s)
        _write(path, key, found)
    return found


def rsus_everywhere(
    network: RoadNetwork, *, min_m: float = 60.0, max_m: float = 300.0, setback_m: float = 60.0
) -> tuple[Rsu, ...]:
    """An RSU for every segment that has a stretch worth watching before the queue at its end."""
    rsus = []
    for name in sorted(network.segments):
        end_m = round(network.segments[name].length_m - setback_m, 1)
        if end_m >= min_m:
            stretch = WatchedStretch(
                segment=name, from_m=max(0.0, round(end_m - max_m, 1)), to_m=end_m
            )
            rsus.append(Rsu(id=f"rsu-{name}", watch=(stretch,)))
    return tuple(rsus)


def _fingerprint(spec: DaySpec) -> str:
    """Cache key: changes with everything that the record depends on."""
    said = hashlib.sha256()
    for path in spec.files:
        said.update(path.read_bytes())
    rest = (spec.segments, spec.rsus, spec.begin_s, spec.end_s, spec.step_s, spec.rule)
    times = (spec.interval_s, spec.window_every_s, spec.window_s, spec.seed)
    said.update(repr((rest, times)).encode())
    return said.hexdigest()


def _write(path: Path, key: str, recorded: RecordedTraffic) -> None:
    traffic, seen = recorded.traffic, recorded.observations
    tables = (traffic.present_s, traffic.distance_m, traffic.waiting_s, traffic.entered)
    part = path.with_suffix(".part.npz")
    np.savez_compressed(
        part,
        key=np.array(key),
        times=np.array([traffic.begin_s, traffic.interval_s, recorded.every_s]),
        segments=np.array(traffic.segments),
        tables=np.array(tables),
        seen_s=np.array([o.time_s for o in seen]),
        rsus=np.array([o.rsu for o in seen], dtype=np.str_),
        watched=np.array([o.segment for o in seen], dtype=np.str_),
        windows=_rows(seen),
    )
    part.replace(path)


def _read(path: Path, key: str) -> RecordedTraffic | None:
    """None where there is no record, a damaged one, or one of something else."""
    try:
        with np.load(path, allow_pickle=False) as file:
            if str(file["key"]) != key:
                return None
            begin_s, interval_s, every_s = file["times"].tolist()
            traffic = Traffic(
                begin_s, interval_s, tuple(file["segments"].tolist()), *file["tables"]
            )
            columns = (file[name].tolist() for name in ("seen_s", "rsus", "watched", "windows"))
            observations = tuple(
                Observation(time_s, rsu, segment, _window(row))
                for time_s, rsu, segment, row in zip(*columns, strict=True)
            )
    except (OSError, ValueError, KeyError, BadZipFile):
        return None
    return RecordedTraffic(traffic, observations, every_s)


def _rows(seen: Sequence[Observation]) -> Array:
    """One row a window, NaN for what it has not."""
    nothing = (None,) * len(_WINDOW_FIELDS)
    rows = [nothing if o.truth is None else astuple(o.truth) for o in seen]
    return np.array(rows, dtype=np.float64).reshape(-1, len(_WINDOW_FIELDS))


def _window(row: Sequence[float]) -> TrueWindow | None:
    value = dict(zip(_WINDOW_FIELDS, row, strict=True))
    if np.isnan(value["vehicles"]):
        return None
    gap = value["mean_gap_m"]
    return TrueWindow(
        value["mean_speed_mps"],
        value["mean_acceleration_mps2"],
        value["density_veh_per_m"],
        value["speed_std_mps"],
        value["acceleration_variance_m2ps4"],
        None if np.isnan(gap) else gap,
        int(value["vehicles"]),
        1 if value["y_e"] == 1 else 0,
        bool(value["near_threshold"]),
    )

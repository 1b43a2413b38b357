"""A `History` as a file, and what an hour is worth to those whose drives it has."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Final

import numpy as np

from dispatcher_daemon.fleet.learning import HOURS, History
from slipstream.energy.consumption import steady_energy_kwh
from slipstream.errors import InputError
from slipstream.files import MAX_RESULTS_BYTES, read_file
from slipstream.roads import RoadNetwork
from slipstream.vehicle_types import VehicleType

_KIND: Final = "slipstream movements 1"


def save_history(history: History, path: Path) -> None:
    """Write it as JSON, byte for byte the same for the same history."""
    rows = []
    for i, (a, b) in enumerate(history.movements):
        hours = np.flatnonzero(history.count[i]).tolist()
        columns = (
            [int(history.count[i, h]) for h in hours],
            [round(1e6 * history.loss_kwh[i, h]) for h in hours],
            [round(float(history.seconds[i, h]), 2) for h in hours],
            [int(history.stops[i, h]) for h in hours],
        )
        rows.append([a, b, hours, *columns])
    lines = ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)
    text = f'{{"kind": "{_KIND}", "movements": [\n{lines}\n]}}\n'
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_text(text, encoding="utf-8")
    unfinished.replace(path)


def load_history(path: Path) -> History:
    """Read what `save_history` wrote.

    Raises:
        InputError: the file is missing or no history.
    """
    mend = "delete it, so that it is recorded again"
    try:
        data = json.loads(read_file(path, MAX_RESULTS_BYTES, mend))
        if data["kind"] != _KIND:
            raise InputError(path, f"not of the kind {_KIND!r}", mend)
        rows = data["movements"]
        table = np.zeros((4, len(rows), HOURS))
        for i, (_, _, hours, *columns) in enumerate(rows):
            table[:, i, hours] = columns
        count, loss, seconds, stops = table
        pairs = tuple((str(a), str(b)) for a, b, *_ in rows)
        return History(pairs, count, loss / 1e6, seconds, stops)
    except (ValueError, KeyError, TypeError, IndexError, RecursionError) as error:
        raise InputError(path, f"not a history: {error}", mend) from None


def time_worth_kw(history: History, network: RoadNetwork, kind: VehicleType) -> float:
    """What an hour is worth at least to vehicles of a type that drive at the limit, or at their top
    speed, kWh.

    With a factor f on all speeds, drag and braking grow with f² and time falls with 1/f, so
    driving at the limit is best only if time costs 2 (E − E_rolling) / T. A path with less
    time has that value: its vehicle may drive slower on the rest. A history is the paper's car's:
    another type loses more or less by what both need for a segment, and has its own times.
    """
    # Others drive beyond the network too, where it is the connected part of a larger net.
    inside = np.array([a in network.segments for a, _ in history.movements], dtype=np.bool_)
    passed = history.count[inside].sum(axis=1)
    segments = [network.segments[a] for a, _ in history.movements if a in network.segments]
    length_m = np.array([segment.length_m for segment in segments])
    physics, top_mps = kind.profile.physics, kind.max_speed_mps or math.inf
    limits_mps = [segment.speed_limit_mps for segment in segments]
    speeds_mps = [min(limit_mps, top_mps) for limit_mps in limits_mps]
    own = np.array([steady_energy_kwh(1.0, v, vehicle=physics) for v in speeds_mps])
    of_car = np.array([steady_energy_kwh(1.0, v) for v in limits_mps])
    longer = np.array(limits_mps) / np.array(speeds_mps)
    loss_kwh = history.loss_kwh[inside] * (own / of_car)[:, np.newaxis]
    rolling_j = physics.rolling_force_n * float(passed @ length_m)
    beyond_kwh = float(loss_kwh.sum()) - physics.electrical_kwh(rolling_j)
    hours = float((history.seconds[inside] * longer[:, np.newaxis]).sum()) / 3600
    return 2 * max(0.0, beyond_kwh) / hours if hours > 0 else 0.0

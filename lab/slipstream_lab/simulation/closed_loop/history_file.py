"""A `History` as a file, and what an hour is worth to those whose drives it has."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import numpy as np

from dispatcher_daemon.fleet.learning import HOURS, History
from slipstream.energy.consumption import PAPER_CAR
from slipstream.errors import InputError
from slipstream.files import MAX_RESULTS_BYTES, read_file
from slipstream.roads import RoadNetwork

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


def time_worth_kw(history: History, network: RoadNetwork) -> float:
    """What an hour is worth at least to those who drive at the limit, kWh.

    With a factor f on all speeds, drag and braking grow with f² and time falls with 1/f, so
    driving at the limit is best only if time costs 2 (E − E_rolling) / T. A path with less
    time has that value: its vehicle may drive slower on the rest.
    """
    # Others drive beyond the network too, where it is the connected part of a larger net.
    inside = np.array([a in network.segments for a, _ in history.movements], dtype=np.bool_)
    passed = history.count[inside].sum(axis=1)
    length_m = np.array(
        [network.segments[a].length_m for a, _ in history.movements if a in network.segments]
    )
    rolling_j = PAPER_CAR.rolling_force_n * float(passed @ length_m)
    beyond_kwh = float(history.loss_kwh[inside].sum()) - PAPER_CAR.electrical_kwh(rolling_j)
    hours = float(history.seconds[inside].sum()) / 3600
    return 2 * max(0.0, beyond_kwh) / hours if hours > 0 else 0.0

"""Passages of movements, counted along the traces of drives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from dispatcher_daemon.fleet.learning.history import HOURS, Array, History
from slipstream.energy.consumption import PAPER_CAR, wheel_power_w
from slipstream.energy.drive import DrivingStyle

_STANDING_MPS: Final = 0.1
_HOUR_S: Final = 3600.0


@dataclass
class DrivenTrace:
    """One vehicle's drive: speeds at the steps, and at which of them it came onto which segment of
    its route; the first entry is where it came onto the road.
    """

    begin_s: float
    route: Sequence[str]
    speeds_mps: list[float] = field(default_factory=list)
    entries: list[tuple[int, int]] = field(default_factory=list)


class Passages:
    """Sums up passages of movements.

    Args:
        style: gaining speed by which time is put down to the movement that lost it.
    """

    def __init__(
        self, limits_mps: Mapping[str, float], step_s: float, style: DrivingStyle | None = None
    ) -> None:
        self._limits, self._step_s = limits_mps, step_s
        self._gain_mps2 = (style or DrivingStyle()).acceleration_mps2
        self._row: dict[tuple[str, str], int] = {}
        self._tables: list[tuple[Array, Array]] = []

    def count(self, traces: Sequence[DrivenTrace]) -> None:
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

    def _along(self, traces: Sequence[DrivenTrace]) -> tuple[Array, Array]:
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

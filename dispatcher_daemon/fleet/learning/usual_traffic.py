"""Usual traffic of watched segments, learned from RSUs' states by hour of the day."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from dispatcher_daemon.fleet.learning.history import HOURS, OF_HOUR, Array, hour_weights
from dispatcher_daemon.traffic import MIN_SPEED_MPS, TrafficSnapshot
from slipstream.orders import SpeedSum
from slipstream.roads import RoadNetwork

MIN_WINDOWS: Final = 30.0
"""Fewer say too little of a segment: its speed is the limit until then, and its gate is as it is
now."""


class UsualTraffic:
    """Sums of the mean speeds and flags that RSUs have measured, once a cycle, and what they lead
    to expect.
    """

    def __init__(self, network: RoadNetwork, sums: Iterable[SpeedSum] = ()) -> None:
        self._limits = {name: s.speed_limit_mps for name, s in network.segments.items()}
        self._sums: dict[str, Array] = {}
        self._pending: dict[tuple[str, int], Array] = {}
        for one in sums:
            table = self._sums.setdefault(one.segment, np.zeros((4, HOURS)))
            table[:, one.hour] += (one.count, one.speed_mps, one.states, one.calm)

    def on_traffic(self, snapshot: TrafficSnapshot, hour: int) -> None:
        """The traffic of one cycle; of segments without a fresh state it says nothing."""
        for name, traffic in snapshot.segments.items():
            if not traffic.watched:
                continue
            measured = traffic.measured_speed_mps
            speed_mps = 0.0 if measured is None else min(measured, self._limits[name])
            seen = np.array([measured is not None, speed_mps, True, traffic.open], dtype=float)
            self._sums.setdefault(name, np.zeros((4, HOURS)))[:, hour] += seen
            self._pending[name, hour] = self._pending.get((name, hour), 0.0) + seen

    def pending(self) -> tuple[SpeedSum, ...]:
        """What has been counted since `stored` was called last."""
        return tuple(
            SpeedSum(name, hour, *map(float, sums))
            for (name, hour), sums in sorted(self._pending.items())
        )

    def stored(self) -> None:
        """What was pending is in the database."""
        self._pending = {}

    def speeds_mps(self, hour: int) -> dict[str, float]:
        """Usual speeds at an hour of the day, of segments that were seen often enough; as `judge`
        gives them, in mm/s.

        The mean of the hour and, at half their weight, its neighbours, drawn towards the day's as
        in `dispatcher_daemon.fleet.learning.History`.
        """
        found = self._means(hour, 0, 1)
        return {
            name: max(MIN_SPEED_MPS, min(round(usual, 3), self._limits[name]))
            for name, usual in found.items()
        }

    def open_shares(self, hour: int) -> dict[str, float]:
        """Shares of the states that opened the gate, likewise."""
        return {name: round(share, 4) for name, share in self._means(hour, 2, 3).items()}

    def _means(self, hour: int, counts: int, sums: int) -> dict[str, float]:
        """Means of rows of the tables, by segment."""
        weight, found = hour_weights(hour), {}
        for name, table in self._sums.items():
            count, total = table[counts].sum(), table[sums].sum()
            if name in self._limits and count >= MIN_WINDOWS:
                count_now, now = table[counts] @ weight, table[sums] @ weight
                found[name] = float((now + OF_HOUR * total / count) / (count_now + OF_HOUR))
        return found

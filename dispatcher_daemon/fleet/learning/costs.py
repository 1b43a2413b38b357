"""Costs of movements learned from the fleet's own positions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from dispatcher_daemon.fleet.learning.history import HOUR_NS, HOURS, Array, History
from dispatcher_daemon.fleet.learning.passages import Passages
from dispatcher_daemon.fleet.learning.traces import STEP_S, PositionTraces
from dispatcher_daemon.traffic import Expectations
from slipstream.messages import VehiclePosition
from slipstream.orders import MovementSum
from slipstream.roads import RoadNetwork

MIN_PASSAGES: Final = 1000.0
"""Fewer tell too little of a network: costs are those of segments until then."""


class MovementCosts:
    """Sums over passages, and what they lead to expect."""

    def __init__(self, network: RoadNetwork, sums: Iterable[MovementSum] = ()) -> None:
        self._network = network
        self._limits = {name: s.speed_limit_mps for name, s in network.segments.items()}
        self._traces = PositionTraces(network)
        self._sums: dict[tuple[str, str], Array] = {}
        self._pending: dict[tuple[str, str], Array] = {}
        self._expected: tuple[int, Expectations | None] | None = None
        for one in sums:
            table = self._sums.setdefault((one.segment, one.following), np.zeros((4, HOURS)))
            table[:, one.hour] += (one.count, one.loss_kwh, one.seconds, one.stops)

    def on_position(self, position: VehiclePosition) -> None:
        """A vehicle of the fleet reports."""
        self._traces.add(position)

    def count(self) -> None:
        """Count the passages of the drives that have ended since the last call."""
        passages = Passages(self._limits, STEP_S)
        passages.count(self._traces.take())
        found = passages.history()
        tables = np.stack([found.count, found.loss_kwh, found.seconds, found.stops], axis=1)
        for movement, table in zip(found.movements, tables, strict=True):
            for sums in (self._sums, self._pending):
                sums[movement] = sums.get(movement, 0.0) + table

    def pending(self) -> tuple[MovementSum, ...]:
        """What has been counted since `stored` was called last."""
        return tuple(
            MovementSum(a, b, int(hour), *(float(value) for value in table[:, hour]))
            for (a, b), table in sorted(self._pending.items())
            for hour in np.flatnonzero(table[0])
        )

    def stored(self) -> None:
        """What was pending is in the database."""
        self._pending = {}

    def expectations(
        self, now_ns: int, usual_mps: Mapping[str, float] | None = None
    ) -> Expectations | None:
        """What movements are expected to cost at this hour, computed once in it; None: too little
        is known.
        """
        hour = now_ns // HOUR_NS
        if self._expected is None or self._expected[0] != hour:
            self._expected = hour, self._compute(int(hour) % HOURS, usual_mps)
        return self._expected[1]

    def _compute(self, hour: int, usual_mps: Mapping[str, float] | None) -> Expectations | None:
        known = {a: table for a, table in self._sums.items() if set(a) <= set(self._limits)}
        if sum(float(table[0].sum()) for table in known.values()) < MIN_PASSAGES:
            return None
        movements = tuple(sorted(known))
        count, loss, seconds, stops = np.stack([known[a] for a in movements], axis=1)
        history = History(movements, count, loss, seconds, stops)
        return history.expectations(self._network, hour, usual_mps)

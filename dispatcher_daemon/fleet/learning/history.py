"""Costs of movements on another day, and the dispatcher's expectations from them.

A movement is a segment with its successor: a left turn waits longer than a right one. Means of few
passages are shrunk towards means of many: those of an hour towards those of
the day, a movement's towards its segment's, a segment's towards those of all that end at signals,
or of all others (shrinkage with a fixed number of pseudo-observations).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.traffic import Expectations, Movement
from slipstream.energy.consumption import steady_energy_kwh
from slipstream.roads import RoadNetwork

Array = npt.NDArray[np.float64]

HOURS: Final = 24
HOUR_NS: Final = 3600 * 10**9
_OF_DAY: Final = 8.0
"""So many passages at the mean that is drawn towards are added to a movement's and a segment's."""
OF_HOUR: Final = 16.0
_NEIGHBOUR: Final = 0.5
"""What passages of the hours before and after count for."""
_MIN_SHARE: Final = 0.2
"""No movement is expected to cost less, of what it costs at the limit without a stop."""


@dataclass(frozen=True)
class History:
    """Sums over passages, by movement and hour of the day; arrays of shape (movements, 24).

    Attributes:
        loss_kwh: energy that was gone for good; see `Expectations` of traffic.
        stops: times that vehicles came to a stand.
    """

    movements: tuple[Movement, ...]
    count: Array
    loss_kwh: Array
    seconds: Array
    stops: Array

    @cached_property
    def _row(self) -> dict[Movement, int]:
        return {movement: i for i, movement in enumerate(self.movements)}

    def expectations(
        self, network: RoadNetwork, hour: float, usual_mps: Mapping[str, float] | None = None
    ) -> Expectations:
        """What all movements of a network are expected to cost at an hour of the day.

        Where no vehicle drove, it is the physics of the segment's usual speed, or of the limit, and
        what signals, or other junctions, cost on average.
        """
        usual = usual_mps or {}
        pairs = [(a, b) for a in network.segments for b in network.turns(a)]
        basis = [network.segments[a] for a, _ in pairs]
        speeds = [usual.get(s.id, s.speed_limit_mps) for s in basis]
        held = zip(basis, speeds, strict=True)
        steady = np.array([steady_energy_kwh(s.length_m, speed) for s, speed in held])
        free_s = np.array([s.length_m for s in basis]) / np.array(speeds)
        segment = np.unique([a for a, _ in pairs], return_inverse=True)[1]
        kind = np.array([s.end in network.signals for s in basis], dtype=np.int64)
        at = np.array([self._row.get(pair, -1) for pair in pairs])
        weight = hour_weights(int(hour))

        def beyond(table: Array, alone: Array) -> Array:
            day, now = (self._taken(table @ w, at) for w in (np.ones(HOURS), weight))
            passed, passed_now = (self._taken(self.count @ w, at) for w in (np.ones(HOURS), weight))
            extra, extra_now = day - passed * alone, now - passed_now * alone
            mean = _pooled(extra, passed, kind, np.zeros(len(pairs)), 0.0)
            mean = _pooled(extra, passed, segment, mean, _OF_DAY)
            mean = (extra + _OF_DAY * mean) / (passed + _OF_DAY)
            return np.asarray((extra_now + OF_HOUR * mean) / (passed_now + OF_HOUR))

        loss = np.maximum(steady + beyond(self.loss_kwh, steady), _MIN_SHARE * steady)
        seconds = np.maximum(free_s + beyond(self.seconds, free_s), _MIN_SHARE * free_s)
        stops = np.maximum(beyond(self.stops, np.zeros(len(pairs))), 0.0)
        by_pair = (dict(zip(pairs, v.tolist(), strict=True)) for v in (loss, seconds, stops))
        return Expectations(*by_pair)

    @staticmethod
    def _taken(values: Array, at: npt.NDArray[np.int64]) -> Array:
        """Values at rows; 0 for the row -1, a movement without observations."""
        return np.append(values, 0.0)[at]


def hour_weights(hour: int) -> Array:
    """What observations of each hour of the day count for at one of them, shape (24,)."""
    weight = np.zeros(HOURS)
    for step, share in ((0, 1.0), (-1, _NEIGHBOUR), (1, _NEIGHBOUR)):
        weight[(hour + step) % HOURS] += share
    return weight


def _pooled(
    total: Array, count: Array, group: npt.NDArray[np.int64], towards: Array, weight: float
) -> Array:
    """Mean of each one's group, drawn towards a mean by so many observations; (movements,)."""
    sums, counts, first = (
        np.bincount(group, weights=values) for values in (total, count, np.ones(len(group)))
    )
    prior = np.bincount(group, weights=towards) / np.maximum(first, 1.0)
    both = counts + weight
    means = np.divide(sums + weight * prior, both, out=prior.copy(), where=both > 0)
    return np.asarray(means[group])

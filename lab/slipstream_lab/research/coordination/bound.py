"""An upper bound on what any plan is worth: leaders' losses shared out among all who could meet.

A platoon of m vehicles saves m F less what its leader loses, F − L; a vehicle alone loses F. On
each link and in each bin of time the loss C = F − L + 2γ is shared out among all trips that could
be in a platoon whose first vehicle enters in it, by shares that add up to at most one; and each of
them gets γ back, 0 ≤ γ ≤ L. Whatever platoons form, their members are charged no more than the
platoon loses: of m ≥ 2 at most C − m γ ≤ F − L, of one at most C − γ ≤ F. So no plan is worth more
than the sum over trips of the best that each alone reaches against these charges, which is a
dynamic program over stretches and delays. Any shares and any γ give a bound; mirror descent on the
shares and subgradients for γ bring it down (a Lagrangian dual of the time-indexed covering form;
Beck and Teboulle 2003 for the descent).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from slipstream_lab.research.coordination.bins import Bins, TripPart, choose_bins
from slipstream_lab.research.coordination.case import CoordinationCase, Floats

_ITERATIONS: Final = (400, 1000)
"""Least and greatest number of steps."""
_TRIP_ITERATIONS: Final = 300_000
"""Steps times trips, in between: small cases are quick."""
_STEPS: Final = (1000.0, 100.0)
"""Steps of the shares' logarithms at begin and end, divided by the number of them: their sum stays
about the same. Longer ones end in shares that no longer move, shorter ones do not get there.
"""
_BACK_STEP: Final = 0.5
"""Step of γ, in L."""
_TEMPERATURES: Final = (0.3, 0.01)
"""Of the answers that the descent follows, at its begin and end, of a trip's drafting ceiling."""
_LEAST: Final = 1e-300


@dataclass(frozen=True)
class Bound:
    """An upper bound."""

    kwh: float
    bin_s: float


def upper_bound(case: CoordinationCase, iterations: int | None = None) -> Bound:
    """Bound the net value of all plans.

    Args:
        iterations: of the descent; None: by the number of trips.
    """
    bins = choose_bins(case)
    if iterations is None:
        least, most = _ITERATIONS
        iterations = min(most, max(least, _TRIP_ITERATIONS // len(case.link)))
    prices = _Prices(case, bins)
    lowest = np.inf
    for iteration in range(iterations):
        values = prices.answers()
        # A trip's best is never below that of leaving undelayed and alone.
        total = sum(float(np.maximum(value.max(axis=1), 0.0).sum()) for value in values)
        lowest = min(lowest, total)
        done = iteration / iterations
        prices.descend(values, _between(_TEMPERATURES, done), _between(_STEPS, done) / iterations)
    return Bound(lowest, bins.length_ms / 1000)


def _between(ends: tuple[float, float], done: float) -> float:
    """From the first to the second, by equal factors."""
    return float(ends[0] * (ends[1] / ends[0]) ** done)


class _Prices:
    """Shares of the losses, and γ: by the part of `Bins.parts` that trips are in."""

    def __init__(self, case: CoordinationCase, bins: Bins) -> None:
        follower, leader = np.append(case.follower_kwh, 0.0), np.append(case.leader_kwh, 0.0)
        self._case, self._bins = case, bins
        self._loss = (follower - leader)[bins.link]
        self._leader = leader[bins.link]
        self._follower = [follower[case.link[p.trips, : len(p.pool)].T] for p in bins.parts]
        self._scores = [np.where(part.reached, 0.0, -np.inf) for part in bins.parts]
        # Who can meet nobody loses all of F: γ = L for good.
        can = [self._spread(part.reached.astype(np.float64)) for part in bins.parts]
        self._is_single = self._summed(can) <= 1.0
        self._back = np.where(self._is_single, self._leader, 0.0)
        self._mass: list[Floats] = []
        self._pools: list[npt.NDArray[np.int8]] = []
        self._total = np.empty(0)

    def answers(self) -> list[Floats]:
        """Value of each trip's best against the charges by the bin of its first stretch, kWh, by
        part: shape (trips, bins).
        """
        top = max(float(scores.max()) for scores in self._scores)
        self._mass = [np.exp(scores - top) for scores in self._scores]
        self._total = np.maximum(self._summed([self._spread(m) for m in self._mass]), _LEAST)
        rate = (self._loss + 2 * self._back) / self._total
        rate[0] = 0.0
        self._pools = []
        values = []
        for part, mass, follower in zip(self._bins.parts, self._mass, self._follower, strict=True):
            charges, pools = self._charges(part, mass, rate)
            self._pools.append(pools)
            values.append(_answers(self._case, part, follower, charges))
        return values

    def descend(self, values: list[Floats], temperature: float, step: float) -> None:
        """Move shares towards trips that answer with a bin, and γ against its slope. `step`: of
        the logarithms of shares, for an answer that is one bin's.
        """
        slope = np.zeros(len(self._loss))
        for number, (part, value) in enumerate(zip(self._bins.parts, values, strict=True)):
            mass, width = self._mass[number], value.shape[1]
            ceiling = self._follower[number].sum(axis=0)[:, None]
            answers = np.exp((value - value.max(axis=1, keepdims=True)) / (temperature * ceiling))
            answers /= answers.sum(axis=1, keepdims=True)
            for ahead in range(self._bins.ahead + 1):
                pool = part.pool[..., ahead : ahead + width]
                terms = answers * (1 - 2 * mass / self._total[pool])
                terms[self._pools[number] != ahead] = 0.0
                slope += np.bincount(pool.ravel(), terms.ravel(), minlength=len(slope))
            self._scores[number] = self._scores[number] + step * answers
        moved = np.clip(self._back - _BACK_STEP * self._leader * slope, 0.0, self._leader)
        self._back = np.where(self._is_single, self._leader, moved)
        self._back[0] = 0.0

    def _charges(
        self, part: TripPart, mass: Floats, rate: Floats
    ) -> tuple[Floats, npt.NDArray[np.int8]]:
        """(Charge less γ, number of the pool): of the pools that a trip can be in, which differ by
        the bin of the first vehicle, the cheapest; shapes (links of a trip, trips, bins).
        """
        width = mass.shape[1]
        rates, backs = rate[part.pool], self._back[part.pool]
        charges = mass * rates[..., :width] - backs[..., :width]
        pools = np.zeros(charges.shape, dtype=np.int8)
        for ahead in range(1, self._bins.ahead + 1):
            other = mass * rates[..., ahead : ahead + width]
            other -= backs[..., ahead : ahead + width]
            is_less = other < charges
            charges[is_less] = other[is_less]
            pools[is_less] = ahead
        return charges, pools

    def _spread(self, by_bin: Floats) -> Floats:
        """The greatest of the values of the bins that share a pool, for each of a trip's pools."""
        ahead, width = self._bins.ahead, by_bin.shape[1]
        spread = np.zeros((len(by_bin), width + ahead))
        for shift in range(ahead + 1):
            there = spread[:, shift : shift + width]
            np.maximum(there, by_bin, out=there)
        return spread

    def _summed(self, by_trip: Sequence[Floats]) -> Floats:
        """Sums over the trips of each pool, shape (pools,)."""
        found = np.zeros(len(self._loss))
        for part, values in zip(self._bins.parts, by_trip, strict=True):
            weights = np.broadcast_to(values, part.pool.shape)
            found += np.bincount(part.pool.ravel(), weights.ravel(), minlength=len(found))
        found[0] = 0.0
        return found


def _answers(case: CoordinationCase, part: TripPart, follower: Floats, charges: Floats) -> Floats:
    """Best by the bin of the first stretch: a dynamic program over stretches, as for a plan."""
    stops_kwh, trips = case.stop_kwh[part.trips], part.trips
    gains = np.zeros((int(case.stretch[trips].max()) + 1, *part.reached.shape))
    for position, charge in enumerate(charges):
        there = np.flatnonzero(case.link[trips, position] >= 0)
        gain = follower[position, there, None] - charge[there]
        gains[case.stretch[trips[there], position], there] += gain
    value = np.where(part.reached, -case.price_kwh_per_ms * part.delay_ms, -np.inf)
    for number in range(len(gains) - 1, 0, -1):
        value = value + gains[number]
        later = np.maximum.accumulate(value[:, :0:-1], axis=1)[:, ::-1]
        value[:, :-1] = np.maximum(value[:, :-1], later - stops_kwh[:, number, None])
    return np.asarray(value + gains[0])

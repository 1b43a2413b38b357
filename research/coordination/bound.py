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

from dataclasses import dataclass
from typing import Final

import numpy as np

from research.coordination.bins import Bins, choose_bins
from research.coordination.case import Case, Floats

_ITERATIONS: Final = (150, 1000)
"""Least and greatest number of steps."""
_TRIP_ITERATIONS: Final = 30_000
"""Steps times trips, in between: small cases are quick."""
_BACK_STEP: Final = 0.5
"""Step of γ, in L."""
_TEMPERATURES: Final = (0.3, 0.01)
"""Of the answers that the descent follows, at its begin and end, of a trip's drafting ceiling."""
_LEAST: Final = 1e-300


@dataclass(frozen=True)
class Bound:
    """An upper bound.

    Attributes:
        kwh: no plan's net value is above it.
        bin_s: length of the bins of time.
    """

    kwh: float
    bin_s: float


def upper_bound(case: Case, iterations: int | None = None) -> Bound:
    """Bound the net value of all plans.

    Args:
        iterations: of the descent; None: by the number of trips.

    Raises:
        ValueError: driving times that fit no bins: see `choose_bins`.
    """
    bins = choose_bins(case)
    if iterations is None:
        least, most = _ITERATIONS
        iterations = min(most, max(least, _TRIP_ITERATIONS // len(case.link)))
    prices = _Prices(case, bins)
    lowest = np.inf
    hot, cold = _TEMPERATURES
    for iteration in range(iterations):
        gains = prices.charge()
        value = _answers(case, bins, gains)
        # A trip's best is never below that of leaving undelayed and alone.
        lowest = min(lowest, float(np.maximum(value.max(axis=1), 0.0).sum()))
        prices.descend(value, hot * (cold / hot) ** (iteration / iterations))
    return Bound(lowest, bins.length_ms / 1000)


class _Prices:
    """Shares of the losses, and γ."""

    def __init__(self, case: Case, bins: Bins) -> None:
        follower, leader = np.append(case.follower_kwh, 0.0), np.append(case.leader_kwh, 0.0)
        self._case, self._bins = case, bins
        self._follower = follower[case.link.T]
        self._ceiling = self._follower.sum(axis=0)
        self._loss = (follower - leader)[bins.link]
        self._leader = leader[bins.link]
        self._scores = np.where(bins.reached, 0.0, -np.inf)
        # Who can meet nobody loses all of F: γ = L for good.
        self._is_single = self._summed(self._spread(bins.reached.astype(np.float64))) <= 1.0
        self._back = np.where(self._is_single, self._leader, 0.0)

    def charge(self) -> Floats:
        """What each trip gains on each stretch in each bin, less charges, kWh.

        Returns:
            Shape (stretches, trips, bins).
        """
        case, bins = self._case, self._bins
        self._mass = np.exp(self._scores - self._scores.max())
        self._total = np.maximum(self._summed(self._spread(self._mass)), _LEAST)
        rate = (self._loss + 2 * self._back) / self._total
        rate[0] = 0.0
        width = bins.reached.shape[1]
        rates, backs = rate[bins.pool], self._back[bins.pool]
        # A vehicle's pools differ by the bin of their first vehicle: it is in the cheapest.
        charges = self._mass * rates[..., :width] - backs[..., :width]
        self._pool = np.zeros(charges.shape, dtype=np.int8)
        for ahead in range(1, bins.ahead + 1):
            other = self._mass * rates[..., ahead : ahead + width]
            other -= backs[..., ahead : ahead + width]
            is_less = other < charges
            charges[is_less] = other[is_less]
            self._pool[is_less] = ahead
        gains = np.zeros((case.stop_kwh.shape[1], *bins.reached.shape))
        for position in range(len(charges)):
            there = np.flatnonzero(case.link[:, position] >= 0)
            gain = self._follower[position, there, None] - charges[position, there]
            gains[case.stretch[there, position], there] += gain
        return gains

    def descend(self, value: Floats, temperature: float) -> None:
        """Move shares towards trips that answer with a bin, and γ against its slope.

        Args:
            value: of each trip's best by the bin of its first stretch, shape (trips, bins).
            temperature: of answers, as a share of a trip's drafting ceiling.
        """
        bins, width = self._bins, self._bins.reached.shape[1]
        excess = value - value.max(axis=1, keepdims=True)
        answers = np.exp(excess / (temperature * self._ceiling[:, None]))
        answers /= answers.sum(axis=1, keepdims=True)
        slope = np.zeros(bins.pools)
        for ahead in range(bins.ahead + 1):
            pool = bins.pool[..., ahead : ahead + width]
            terms = np.where(
                self._pool == ahead, answers * (1 - 2 * self._mass / self._total[pool]), 0.0
            )
            slope += np.bincount(pool.ravel(), terms.ravel(), minlength=bins.pools)
        moved = np.clip(self._back - _BACK_STEP * self._leader * slope, 0.0, self._leader)
        self._back = np.where(self._is_single, self._leader, moved)
        self._back[0] = 0.0
        self._scores = self._scores + answers

    def _spread(self, by_bin: Floats) -> Floats:
        """The greatest of the values of the bins that share a pool, for each of a trip's pools."""
        ahead, width = self._bins.ahead, by_bin.shape[1]
        spread = np.zeros((len(by_bin), width + ahead))
        for shift in range(ahead + 1):
            part = spread[:, shift : shift + width]
            np.maximum(part, by_bin, out=part)
        return spread

    def _summed(self, by_trip: Floats) -> Floats:
        """Sums over the trips of each pool, shape (pools,)."""
        pool = self._bins.pool
        weights = np.broadcast_to(by_trip, pool.shape)
        found = np.bincount(pool.ravel(), weights.ravel(), minlength=self._bins.pools)
        found[0] = 0.0
        return np.asarray(found, dtype=np.float64)


def _answers(case: Case, bins: Bins, gains: Floats) -> Floats:
    """Value of each trip's best by the bin of its first stretch, kWh; hubs as in a plan."""
    value = np.where(bins.reached, -case.price_kwh_per_ms * bins.delay_ms, -np.inf)
    for number in range(len(gains) - 1, 0, -1):
        value = value + gains[number]
        later = np.maximum.accumulate(value[:, :0:-1], axis=1)[:, ::-1]
        later = later - case.stop_kwh[:, number, None]
        value[:, :-1] = np.maximum(value[:, :-1], later)
    return np.asarray(value + gains[0])

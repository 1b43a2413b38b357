"""Our own: trips near each other leave their platoons together and choose anew, again and again."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from slipstream_lab.research.coordination.case import CoordinationCase, Ints
from slipstream_lab.research.coordination.pairwise import pairwise_leaders
from slipstream_lab.research.coordination.plan import (
    Plan,
    entries_ms,
    evaluate,
    trip_values_kwh,
    undelayed,
)
from slipstream_lab.research.coordination.schedule import Schedule, Worth, answer_in_turn

_MAX_ROUNDS: Final = 10
_ROUNDING_KWH: Final = 1e-9
_MAX_REMOVED: Final = 12
_NEAR_MS: Final = 600_000
"""Trips that may choose together enter one link within so long of each other, without waits."""
_TEMPERATURES: Final = (0.1, 0.002)
"""At the begin and at the end of the annealing, of a trip's mean drafting ceiling."""
_TRIALS: Final = 4_000
_TRIALS_A_TRIP: Final = 100


def local_search(case: CoordinationCase, seed: int = 1, trials: int | None = None) -> Plan:
    """The best plan of a search by simulated annealing; same seed, same plan.

    It begins with the better of two plans: answers in turn as if savings were shared equally, which
    draws vehicles into the larger platoon, and pairwise plans with leaders. Then some trips that
    use one link at about the same time are taken off the roads and put back one by one in random
    order, each where it adds most to all, or as if savings were shared.

    Args:
        trials: number of such removals; None: by the number of trips.
    """
    starts = (
        answer_in_turn(case, undelayed(case), Worth.equally_shared(), _MAX_ROUNDS),
        pairwise_leaders(case),
    )
    improved = [answer_in_turn(case, plan, Worth.to_all(), _MAX_ROUNDS) for plan in starts]
    start = max(improved, key=lambda plan: evaluate(case, plan).net_kwh)
    count = min(_TRIALS, _TRIALS_A_TRIP * len(start)) if trials is None else trials
    rng = np.random.default_rng(seed)
    search = _Search(case, start)
    hot, cold = (share * case.ceiling_kwh / len(start) for share in _TEMPERATURES)
    for trial in range(count):
        search.try_once(rng, hot * (cold / hot) ** (trial / count))
    # In the best plan nobody may have something better left.
    found = answer_in_turn(case, search.best, Worth.to_all(), _MAX_ROUNDS)
    plans = [nobody_worse_off(case, plan) for plan in (*starts, start, found)]
    return max(plans, key=lambda plan: evaluate(case, plan).net_kwh)


def nobody_worse_off(case: CoordinationCase, plan: Plan) -> Plan:
    """The plan changed until each carrier has at least what it has alone.

    Of a carrier that has less, the trip that loses most follows whom it waits for instead of
    leading it, if all together lose no more by that than a millisecond's wait; else it leaves
    undelayed. Without waits none loses.
    """
    kept = plan.copy()
    own = trip_values_kwh(case, kept)
    is_tried = np.zeros(len(plan), dtype=bool)
    while True:
        carriers = np.bincount(case.carrier, weights=own)
        losing = np.where(carriers[case.carrier] < -_ROUNDING_KWH, own, np.inf)
        trip = int(losing.argmin())
        if losing[trip] == np.inf:
            return kept
        before, least_kwh = kept[trip].copy(), own.sum() - case.price_kwh_per_ms - _ROUNDING_KWH
        if not is_tried[trip] and before[-1] < case.slack_ms[trip]:
            is_tried[trip] = True
            # Who waits for another enters with it, and then chance has decided who leads.
            kept[trip] = np.where(before > 0, before + 1, 0)
            changed = trip_values_kwh(case, kept)
            if changed[trip] > own[trip] and changed.sum() >= least_kwh:
                own = changed
                continue
        kept[trip] = 0
        own = trip_values_kwh(case, kept)


class _Search:
    """A plan under annealing, and the best one so far."""

    def __init__(self, case: CoordinationCase, plan: Plan) -> None:
        self._schedule = Schedule(case, plan)
        self._worths = (Worth.to_all(), Worth.equally_shared())
        self._gained_kwh = self._best_kwh = 0.0
        self.best = plan.copy()
        undelayed_ms = entries_ms(case, np.zeros_like(plan))
        self._case, self._undelayed_ms = case, undelayed_ms
        self._users: list[tuple[Ints, Ints]] = []
        for link in range(len(case.length_m)):
            trips, positions = np.nonzero(case.link == link)
            times = undelayed_ms[trips, positions]
            order = np.argsort(times, kind="stable")
            self._users.append((trips[order], times[order]))

    def try_once(self, rng: np.random.Generator, temperature_kwh: float) -> None:
        """Take some trips off, put them back, and keep that or not."""
        schedule = self._schedule
        chosen = self._some(rng)
        before = schedule.plan[chosen].copy()
        change = 0.0
        for trip in chosen.tolist():
            schedule.remove(trip)
            change -= schedule.value_kwh(trip, schedule.plan[trip], self._worths[0])
        worth = self._worths[int(rng.random() < 0.5)]
        for trip in chosen[rng.permutation(len(chosen))].tolist():
            value, delays = schedule.best(trip, worth)
            if worth is not self._worths[0]:
                value = schedule.value_kwh(trip, delays, self._worths[0])
            schedule.add(trip, delays)
            change += value
        if change >= 0 or rng.random() < math.exp(change / temperature_kwh):
            self._gained_kwh += change
            if self._gained_kwh > self._best_kwh + 1e-9:
                self._best_kwh = self._gained_kwh
                self.best = schedule.plan.copy()
            return
        for trip in chosen.tolist():
            schedule.remove(trip)
        for trip, delays in zip(chosen.tolist(), before, strict=True):
            schedule.add(trip, delays)

    def _some(self, rng: np.random.Generator) -> Ints:
        """A trip and some others that use one of its links at about its time."""
        case = self._case
        trip = int(rng.integers(len(case.link)))
        position = int(rng.integers(case.link_count[trip]))
        trips, times = self._users[case.link[trip, position]]
        at = self._undelayed_ms[trip, position]
        reach = min(_NEAR_MS, int(case.useful_ms.max()))
        low, high = np.searchsorted(times, (at - reach, at + reach + 1))
        near = trips[low:high]
        near = near[near != trip]
        size = min(len(near), int(rng.integers(1, _MAX_REMOVED)))
        others = rng.choice(near, size=size, replace=False) if size else near[:0]
        return np.append(others, trip)

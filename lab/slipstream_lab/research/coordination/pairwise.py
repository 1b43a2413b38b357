"""Pairwise plans with cluster leaders (van de Hoef, Johansson, Dimarogonas 2015, 2018)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slipstream_lab.research.coordination.case import CoordinationCase, Floats, Ints
from slipstream_lab.research.coordination.plan import Plan, entries_ms, undelayed

_Delays = npt.NDArray[np.int32]


def pairwise_leaders(case: CoordinationCase) -> Plan:
    """Leaders drive as if alone; each other trip joins the leader that saves it most, or none.

    S. van de Hoef, K. H. Johansson, D. V. Dimarogonas: Fuel-efficient en route formation of truck
    platoons, IEEE T-ITS 19 (2018), and their "Coordinating truck platooning by clustering pairwise
    fuel-optimal plans", ITSC 2015. A pairwise plan makes a follower meet a leader that keeps its
    own plan; there by another speed, here by a later departure. Leaders are chosen greedily by the
    sum of what followers save, as there: the trip whose change of role adds most, until none does.
    """
    saving, delay_ms = _pairs(case)
    leader = _choose(saving)
    plan = undelayed(case)
    for trip, ahead in enumerate(leader.tolist()):
        if ahead >= 0:
            plan[trip] = delay_ms[trip, ahead]
    return plan


def _pairs(case: CoordinationCase) -> tuple[Floats, _Delays]:
    """What trip i saves behind trip j, which leaves undelayed, and how much later i leaves for
    that, ms; shapes (trips, trips). Pairs that cannot meet, or lose by it, save 0.
    """
    entries = entries_ms(case, undelayed(case))
    count = len(entries)
    saving = np.zeros((count, count))
    delay_ms = np.full((count, count), -1, dtype=np.int32)
    for link in range(len(case.length_m)):
        trips, positions = np.nonzero(case.link == link)
        times = entries[trips, positions]
        later = (times[None, :] - times[:, None]).astype(np.int32)
        block = np.ix_(trips, trips)
        known = delay_ms[block]
        # Two trips stay together from link to link; if not, the first meeting counts.
        meets = (later >= 0) & (later <= case.slack_ms[trips, None])
        meets &= (known < 0) | (known == later)
        saving[block] += np.where(meets, case.follower_kwh[link], 0.0)
        delay_ms[block] = np.where(meets, later, known)
    saving -= case.price_kwh_per_ms * np.maximum(delay_ms, 0)
    np.maximum(saving, 0.0, out=saving)
    np.fill_diagonal(saving, 0.0)
    return saving, delay_ms


def _choose(saving: Floats) -> Ints:
    """The leader of each trip; −1: itself a leader, or alone."""
    count = len(saving)
    is_leader = np.zeros(count, dtype=bool)
    best = np.zeros(count)
    # What everybody would save if a further trip were a leader: followers that gain by it.
    gain = saving.sum(axis=0)
    while True:
        net = np.where(is_leader, -np.inf, gain - best)
        chosen = int(net.argmax())
        if net[chosen] <= 1e-12:
            break
        is_leader[chosen] = True
        follows = ~is_leader & (saving[:, chosen] > best)
        changed = np.append(np.flatnonzero(follows), chosen)
        before = np.maximum(saving[changed] - best[changed, None], 0.0)
        best[follows] = saving[follows, chosen]
        best[chosen] = 0.0
        after = np.maximum(saving[changed] - best[changed, None], 0.0)
        # A leader joins nobody.
        after[-1] = 0.0
        gain += (after - before).sum(axis=0)
    offers = np.where(is_leader[None, :], saving, 0.0)
    leader = offers.argmax(axis=1)
    joins = ~is_leader & (offers[np.arange(count), leader] > 0)
    return np.where(joins, leader, -1)

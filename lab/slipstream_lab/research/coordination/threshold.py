"""Release by a threshold: vehicles leave a hub when k wait or the first has waited long enough."""

from __future__ import annotations

import heapq
from itertools import product
from typing import Final

import numpy as np

from slipstream_lab.research.coordination.case import CoordinationCase
from slipstream_lab.research.coordination.plan import Plan, evaluate, undelayed
from slipstream_lab.research.coordination.trips.freight import MS

_SIZES: Final = (2, 5)
_WAITS_S: Final = (30, 120, 600)


def best_threshold(case: CoordinationCase) -> Plan:
    """The best of several thresholds, with waits at origins only and at all hubs; undelayed if all
    of them lose. For this case it is chosen afterwards, which favours it.

    Waiting until enough are there is the feedback policy of A. Adler, D. Miculescu, S. Karaman:
    Optimal policies for platooning and ride sharing in autonomy-enabled transportation, WAFR 2016;
    the longest wait bounds it.
    """
    plans = [undelayed(case)]
    longest_s = int(case.useful_ms.max()) / MS
    # Beyond the first that nobody reaches, longer waits are all the same.
    waits_s = [w for w in _WAITS_S if w < longest_s] + [longest_s]
    for size, wait_s, at_hubs in product(_SIZES, waits_s, (False, True)):
        plans.append(release(case, size, round(MS * wait_s), at_hubs))
    return max(plans, key=lambda plan: evaluate(case, plan).net_kwh)


def release(case: CoordinationCase, size: int, wait_ms: int, at_hubs: bool) -> Plan:
    """Vehicles wait for each other before a link; all go when ``size`` of them wait or the first
    has waited ``wait_ms``. Who has no time left goes alone.

    Args:
        at_hubs: whether they do so at all hubs on the way, or at their origins' ramps only.
    """
    plan = undelayed(case)
    begins = [
        [int(np.flatnonzero(row == stretch)[0]) for stretch in range(int(row.max()) + 1)]
        for row in case.stretch
    ]
    queues: dict[int, list[int]] = {}
    stretch_of = [0] * len(plan)
    events: list[tuple[int, int, int, int]] = []
    """(Time, 0 = arrival or 1 = deadline, trip, stretch); a deadline of who has left is void."""

    def arrive(trip: int, stretch: int) -> None:
        position = begins[trip][stretch]
        at = case.ready_ms[trip] + case.offset_ms[trip, position] + plan[trip, stretch]
        heapq.heappush(events, (int(at), 0, trip, stretch))

    def leave(trips: list[int], now_ms: int) -> None:
        for trip in trips:
            stretch = stretch_of[trip]
            position = begins[trip][stretch]
            late = now_ms - int(case.ready_ms[trip] + case.offset_ms[trip, position])
            plan[trip, stretch:] = late
            stretch_of[trip] = stretch + 1
            if at_hubs and stretch + 1 < len(begins[trip]):
                arrive(trip, stretch + 1)

    for trip in range(len(plan)):
        arrive(trip, 0)
    while events:
        now_ms, kind, trip, stretch = heapq.heappop(events)
        queue = queues.setdefault(int(case.link[trip, begins[trip][stretch]]), [])
        if kind == 0:
            queue.append(trip)
            left_ms = int(case.slack_ms[trip] - plan[trip, stretch])
            until = now_ms + (min(wait_ms, left_ms) if len(queue) == 1 else left_ms)
            heapq.heappush(events, (until, 1, trip, stretch))
            if len(queue) >= size:
                leave(queue, now_ms)
                queue.clear()
        elif trip in queue and stretch_of[trip] == stretch:
            if trip == queue[0]:
                leave(queue, now_ms)
                queue.clear()
            else:
                queue.remove(trip)
                leave([trip], now_ms)
    return plan

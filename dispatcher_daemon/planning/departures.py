"""Departure times at which platoons meet: the paper's schedule manager."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable
from typing import Final

import numpy as np

from dispatcher_daemon.planning.itineraries import Itinerary, Planner
from dispatcher_daemon.platooning import Meetings

MAX_DEPARTURES = 6
"""Maximum number of departures that are evaluated exactly."""
_ROUNDING_S: Final = 1e-9


def meeting_departures(
    planner: Planner, itinerary: Itinerary, meetings: Meetings, max_departures: int = MAX_DEPARTURES
) -> list[float]:
    """Departures at which a vehicle would meet many others, the most promising first, s.

    Leaving Δ later shifts each entry by Δ, but for waits at stops, which the exact timetable knows.
    Each passage of another vehicle over a shared segment names the Δ at which both enter it at
    once. A departure's score is the sum of follower savings over the Δ within the synchronisation
    window around it.
    """
    first, last = planner.window_s(itinerary.number)
    leaves = itinerary.depart_s
    shifts: list[float] = []
    weights: list[float] = []
    for segment, passages in itinerary.traversals.items():
        saving = meetings.shares[segment].follower_kwh
        there = meetings.on(segment)
        for entry, _, key in passages:
            begin = bisect_left(there, (entry + first - leaves,))
            end = bisect_left(there, (entry + last - leaves + _ROUNDING_S,))
            own = [p[0] - entry for p in there[begin:end] if p[2] != key]
            shifts += own
            weights += [saving] * len(own)
    if not shifts:
        return []
    order = np.argsort(shifts, kind="stable")
    at, weight_at = np.array(shifts)[order], np.array(weights)[order]
    total = np.concatenate([[0.0], np.cumsum(weight_at)])
    window = meetings.sync_window_s
    low = np.searchsorted(at, at - window, "left")
    high = np.searchsorted(at, at + window, "right")
    score = total[high] - total[low]
    best_first = at[np.argsort(-score, kind="stable")]
    chosen: list[float] = []
    while len(best_first) and len(chosen) < max_departures:
        chosen.append(float(best_first[0]))
        best_first = best_first[np.abs(best_first - best_first[0]) > window]
    return [min(max(leaves + shift, first), last) for shift in chosen]


def alternatives(
    planner: Planner, itinerary: Itinerary, meetings: Meetings, max_departures: int = MAX_DEPARTURES
) -> Iterable[Itinerary]:
    """The same route at other departures that keep its windows."""
    if itinerary.route is None:
        return
    for depart_s in meeting_departures(planner, itinerary, meetings, max_departures):
        moved = planner.itinerary(itinerary.number, itinerary.stops, itinerary.route.legs, depart_s)
        if moved is not None:
            yield moved


def best_departure(
    planner: Planner, itinerary: Itinerary, meetings: Meetings, max_departures: int = MAX_DEPARTURES
) -> Itinerary:
    """The same route at the departure that saves most with the others, its present one included."""
    candidates = [itinerary, *alternatives(planner, itinerary, meetings, max_departures)]
    return max(candidates, key=lambda c: meetings.gain_kwh(c.traversals) - c.cost_kwh)


def schedule_greedily(planner: Planner, itineraries: Iterable[Itinerary]) -> list[Itinerary]:
    """Route, then schedule: each vehicle in turn leaves when it saves most with those before it.

    Routes stay as they are. It is the reference heuristic for the joint choice.

    Args:
        itineraries: one a vehicle, in the order in which they choose.
    """
    meetings = planner.meetings()
    chosen = []
    for itinerary in itineraries:
        best = best_departure(planner, itinerary, meetings)
        meetings.add(best.traversals)
        chosen.append(best)
    return chosen

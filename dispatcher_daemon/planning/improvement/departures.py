"""Departures from depots and stops at which platoons meet: the paper's schedule manager."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from dispatcher_daemon.planning.improvement.hubs import over_hubs
from dispatcher_daemon.planning.platooning import Meetings
from dispatcher_daemon.planning.roads import timed
from dispatcher_daemon.planning.roads.weights import Floats
from dispatcher_daemon.planning.routes.itineraries import S_PER_H, Itinerary, Planner
from dispatcher_daemon.planning.routes.windows import MAX_WAIT_S

MAX_DEPARTURES: Final = 6
"""Maximum number of departures, and of waits at stops, that are evaluated exactly."""
_ROUNDING_S: Final = 1e-9


@dataclass(frozen=True)
class Encounters:
    """Passages of others over the segments of one vehicle, in the order of `shift_s`.

    Attributes:
        own_s: the vehicle's entry, shape (n,).
        other_s: the other's, likewise.
        shift_s: by which the vehicle would have to enter later, to enter with the other, likewise.
    """

    own_s: Floats
    other_s: Floats
    shift_s: Floats
    kwh: Floats
    window_s: float

    def shifts(
        self, earliest_s: float, latest_s: float, from_s: float = -math.inf
    ) -> list[tuple[float, float]]:
        """(score in kWh, shift in s) of shifts by which passages meet others, best first.

        Each encounter names the shift at which both enter a segment at once. A shift's score is the
        sum of follower savings over those within the synchronisation window around it. Of shifts
        within a window of each other the best is kept.
        """
        own_s, other_s = self.own_s, self.other_s
        found = (own_s >= from_s) & (other_s >= own_s + earliest_s)
        found &= other_s < own_s + latest_s + _ROUNDING_S
        at, window_s = self.shift_s[found], self.window_s
        if not len(at):
            return []
        total = np.zeros(len(at) + 1)
        self.kwh[found].cumsum(out=total[1:])
        low, high = at.searchsorted(at - window_s, "left"), at.searchsorted(at + window_s, "right")
        score = total[high] - total[low]
        chosen: list[tuple[float, float]] = []
        while len(chosen) < MAX_DEPARTURES:
            best = int(score.argmax())
            if score[best] == -math.inf:
                break
            shift = min(max(float(at[best]), earliest_s), latest_s)
            chosen.append((float(score[best]), shift))
            score[np.abs(at - at[best]) <= window_s] = -math.inf
        return chosen


def encounters(planner: Planner, itinerary: Itinerary, meetings: Meetings) -> Encounters:
    """What another departure of a vehicle, or another wait, can bring about."""
    first_s, last_s = (
        moment - itinerary.depart_s for moment in planner.windows.of(itinerary.number)
    )
    waits_s = itinerary.waits_s or (0.0,)
    earliest_s, latest_s = min(first_s, -max(waits_s)), max(last_s, MAX_WAIT_S - min(waits_s))
    counts: list[int] = []
    own: list[float] = []
    others, kwh = array("d"), array("d")
    for segment, passages in itinerary.traversals.items():
        shares = meetings.shares[segment]
        for entry, _, key in passages:
            begin_s, end_s = entry + earliest_s, entry + latest_s + _ROUNDING_S
            entries = meetings.entries_s(segment, begin_s, end_s, key[0])
            own.append(entry)
            counts.append(len(entries))
            others += entries
            kwh += shares.followings_kwh(entries)
    own_s, other_s = np.repeat(own, counts), np.array(others)
    shift_s = other_s - own_s
    order = shift_s.argsort(kind="stable")
    return Encounters(
        own_s[order], other_s[order], shift_s[order], np.array(kwh)[order], meetings.sync_window_s
    )


def meeting_departures(
    planner: Planner, itinerary: Itinerary, met: Encounters, max_departures: int = MAX_DEPARTURES
) -> list[float]:
    """Departures at which a vehicle would meet many others, the most promising first, s.

    Leaving Δ later shifts each entry by Δ, but for waits at stops, which the exact timetable knows.
    """
    first, last = planner.windows.of(itinerary.number)
    leaves = itinerary.depart_s
    shifts = met.shifts(first - leaves, last - leaves)
    return [leaves + shift for _, shift in shifts[:max_departures]]


def alternatives(
    planner: Planner, itinerary: Itinerary, meetings: Meetings, max_departures: int = MAX_DEPARTURES
) -> Iterable[Itinerary]:
    """The same route at other departures, or with another wait at a stop, within its windows."""
    if itinerary.route is None:
        return
    number, stops, legs = itinerary.number, itinerary.stops, itinerary.route.legs
    waits_s, met = itinerary.waits_s, encounters(planner, itinerary, meetings)
    for depart_s in meeting_departures(planner, itinerary, met, max_departures):
        moved = planner.itinerary(number, stops, legs, depart_s, waits_s)
        if moved is not None:
            yield moved
    yield from _waiting(planner, itinerary, met, max_departures)
    for hub, changed in over_hubs(planner, itinerary):
        met = encounters(planner, changed, meetings)
        yield from _waiting(planner, changed, met, max_departures, hub)


def as_planned(planner: Planner, itinerary: Itinerary) -> Itinerary:
    """The same with the waits that a bound vehicle's present plan has."""
    if itinerary.route is None or itinerary.number not in planner.windows.bound:
        return itinerary
    number, stops, legs = itinerary.number, itinerary.stops, itinerary.route.legs
    leaves_s = planner.windows.planned_departure_s(number)
    at_once = timed(
        planner.problem,
        legs,
        planner.problem.fleet.vehicles[number],
        planner.windows.reference_s,
        leaves_s,
    )
    waits_s = planner.windows.planned_waits_s(number, at_once)
    waiting = planner.itinerary(number, stops, legs, leaves_s, waits_s)
    return itinerary if waiting is None else waiting


def longest_wait_s(planner: Planner, itinerary: Itinerary) -> float:
    """The longest wait on a tour that what is saved behind it can pay for, s."""
    if itinerary.route is None or not itinerary.waits_s or not planner.problem.waits_on_tours:
        return 0.0
    kwh = planner.book.followed_kwh(itinerary.traversals, itinerary.route.visits[1].departure_s)
    price_kw = min(planner.problem.price_of_wait_kw(v.place) for v in itinerary.route.visits[1:-1])
    return min(MAX_WAIT_S, kwh / price_kw * S_PER_H) if price_kw > 0 else MAX_WAIT_S


def _waiting(
    planner: Planner, itinerary: Itinerary, met: Encounters, max_waits: int, only: int | None = None
) -> Iterable[Itinerary]:
    """The same route with another wait at the end of one leg, so that the rest of it meets many
    others, the most promising first; none under the paper's objective, which has no such waits.

    Args:
        only: number of the visit to wait at; None: any.
    """
    if itinerary.route is None or not planner.problem.waits_on_tours:
        return
    number, visits, waits_s = itinerary.number, itinerary.route.visits, itinerary.waits_s
    fixed = len(planner.fixed_legs(number) or ())
    found: list[tuple[float, int, float]] = []
    for at in range(max(1, fixed), len(visits) - 1) if only is None else [only]:
        visit = visits[at]
        if not itinerary.route.legs[at].path:
            continue  # the next stop is at the same junction
        price_kw = planner.problem.price_of_wait_kw(visit.place)
        longest_s = MAX_WAIT_S - visit.wait_s
        found += [
            (score - price_kw * shift / S_PER_H, at, visit.wait_s + shift)
            for score, shift in met.shifts(-visit.wait_s, longest_s, visit.departure_s)
        ]
    for _, at, wait_s in sorted(found, reverse=True)[:max_waits]:
        changed_s = (*waits_s[: at - 1], wait_s, *waits_s[at:])
        waiting = planner.itinerary(
            number, itinerary.stops, itinerary.route.legs, itinerary.depart_s, changed_s
        )
        if waiting is not None:
            yield waiting


def best_departure(
    planner: Planner, itinerary: Itinerary, meetings: Meetings, max_departures: int = MAX_DEPARTURES
) -> Itinerary:
    """The same route at the departure that saves most with the others, its present one included."""
    candidates = [itinerary, *alternatives(planner, itinerary, meetings, max_departures)]
    gains_kwh = meetings.gains_kwh(c.traversals for c in candidates)
    better = [kwh - c.cost_kwh for kwh, c in zip(gains_kwh, candidates, strict=True)]
    return candidates[better.index(max(better))]


def schedule_greedily(planner: Planner, itineraries: Iterable[Itinerary]) -> list[Itinerary]:
    """Route, then schedule: each vehicle in turn leaves when it saves most with those before it.

    Routes stay as they are. It is the reference heuristic for the joint choice.

    Args:
        itineraries: one a vehicle, in the order in which they choose.
    """
    meetings = planner.book.meetings()
    chosen = []
    for itinerary in itineraries:
        best = best_departure(planner, itinerary, meetings)
        # Each round changes the departure or one wait.
        for _ in best.waits_s if best is not itinerary else ():
            best, before = best_departure(planner, best, meetings), best
            if best.key == before.key:
                break
        meetings.add(best.traversals)
        chosen.append(best)
    return chosen

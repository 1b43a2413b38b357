"""Platoons that a plan does not have, though its vehicles pass the same roads, and why not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import Final, NamedTuple

from dispatcher_daemon.planning.plans import Candidate, Cycle, DeclinedMeeting
from dispatcher_daemon.planning.platooning import Meetings, apart_at_the_end, pair_saving_kwh
from dispatcher_daemon.planning.roads import Route
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.planning.routes.windows import MAX_WAIT_S
from slipstream.explain import RefusalReason, RefusedPlatoon
from slipstream.vehicle_types import RoutingProfile

MAX_OF_A_REASON: Final = 20
"""Refused platoons that are kept of each reason, most worth first."""
OTHER_WAY: Final = "by another way or departure"
_NEXT_PASSAGES: Final = 3
"""So many vehicles behind each one are looked at, on every segment."""


class _Passage(NamedTuple):
    """One vehicle on one segment; times in s, leg of its route, platoon if it has one."""

    entry_s: float
    leaving_s: float
    vehicle: str
    leg: int
    platoon: str | None


class _Miss(NamedTuple):
    """Two vehicles on one segment without a platoon, the one that enters first before."""

    first: _Passage
    second: _Passage
    segment: str
    saving_kwh: float


def refused_platoons(
    cycle: Cycle, chosen: Candidate, declined: Sequence[DeclinedMeeting] = ()
) -> tuple[RefusedPlatoon, ...]:
    """The refused platoons of a plan, most worth first; at most `MAX_OF_A_REASON` of each reason.

    Looked at are pairs of vehicles that follow each other on a segment, at most `MAX_WAIT_S` apart;
    where a gate is closed, only those that would be a platoon. For the most promising pairs that
    are apart, each way in which one of them could wait for the other is tried exactly.
    """
    found: dict[tuple[str, str, str, str | None], list[_Miss]] = {}
    for miss, reason, detail in _misses(cycle, chosen):
        key = miss.first.vehicle, miss.second.vehicle, reason, detail
        found.setdefault(key, []).append(miss)
    refused: dict[str, list[tuple[RefusedPlatoon, Sequence[_Miss]]]] = {}
    for (_, _, reason, detail), misses in found.items():
        one = _refused(misses, reason, detail)
        refused.setdefault(reason, []).append((one, misses))
    best = {
        reason: sorted(of_one, key=lambda row: (-row[0].saving_kwh, row[0].vehicles))
        for reason, of_one in refused.items()
    }
    kept = [
        one for reason in best if reason != "apart" for one, _ in best[reason][:MAX_OF_A_REASON]
    ]
    if "apart" in best:
        meeting = _Meeting(cycle, chosen)
        kept += [meeting.tried(*row) for row in best["apart"][:MAX_OF_A_REASON]]
    told = {(frozenset(one.vehicles), segment) for one in kept for segment in one.segments}
    others = [
        one
        for one in declined
        if told.isdisjoint((frozenset(one.vehicles), segment) for segment in one.segments)
    ]
    others.sort(key=lambda one: (-one.saving_kwh, one.vehicles))
    kept += [
        RefusedPlatoon(
            one.vehicles, one.segments, "not_worth", OTHER_WAY, one.saving_kwh, 0.0, one.cost_kwh
        )
        for one in others[:MAX_OF_A_REASON]
    ]
    return tuple(sorted(kept, key=lambda one: (-one.saving_kwh, one.vehicles, one.segments)))


def _refused(misses: Sequence[_Miss], reason: str, detail: str | None) -> RefusedPlatoon:
    in_order = sorted(misses, key=lambda miss: miss.first.entry_s)
    first = in_order[0]
    return RefusedPlatoon(
        (first.first.vehicle, first.second.vehicle),
        tuple(miss.segment for miss in in_order),
        reason,  # type: ignore[arg-type]
        detail,
        sum(miss.saving_kwh for miss in in_order),
        round(min(miss.second.entry_s - miss.first.entry_s for miss in in_order), 3),
    )


def _misses(cycle: Cycle, chosen: Candidate) -> Iterator[tuple[_Miss, str, str | None]]:
    """Each pair without a platoon on each segment, with the reason and its detail."""
    problem, window_s = cycle.problem, cycle.settings.sync_window_s
    known: dict[tuple[str, RoutingProfile, RoutingProfile], float] = {}

    def profile(vehicle: str) -> RoutingProfile:
        # A vehicle on the road may have left the fleet.
        listed = vehicle in problem.fleet.vehicle_by_id
        return problem.profile_of(vehicle) if listed else problem.profiles[0]

    for segment, passages in _passages(cycle, chosen).items():
        traffic = cycle.snapshot.segments[segment]
        horizon_s = MAX_WAIT_S if traffic.open else window_s
        for at, first in enumerate(passages):
            behind = (p for p in passages[at + 1 :] if p.vehicle != first.vehicle)
            for second in islice(behind, _NEXT_PASSAGES):
                apart_s = second.entry_s - first.entry_s
                if apart_s > horizon_s:
                    break
                if first.platoon is not None and first.platoon == second.platoon:
                    continue
                key = segment, profile(first.vehicle), profile(second.vehicle)
                if key not in known:
                    road = problem.network.segments[segment]
                    known[key] = pair_saving_kwh(problem, road, traffic, key[1], key[2])
                reason, detail = "apart", None
                if not traffic.open:
                    reason = "turbulent" if traffic.reason == "turbulent" else "unknown"
                    detail = traffic.reason
                elif apart_s <= window_s:
                    detail = _parting(first, second, window_s)
                yield _Miss(first, second, segment, known[key]), reason, detail


def _parting(first: _Passage, second: _Passage, window_s: float) -> str:
    """Why two that enter an open segment together are no platoon on it."""
    entries_s = first.entry_s - second.entry_s
    parting = apart_at_the_end(entries_s, first.leaving_s - second.leaving_s, window_s)
    if parting is not None:
        return parting
    return "others enter before them or leave between them, so that no platoon has room for both"


def _passages(cycle: Cycle, chosen: Candidate) -> dict[str, list[_Passage]]:
    found: dict[str, list[_Passage]] = {}
    for route, plan in zip(chosen.routes, chosen.plans, strict=True):
        for (leg, _, segment, entry, leaving), planned in zip(
            route.entries_s(), plan.segments, strict=True
        ):
            passage = _Passage(entry, leaving, route.vehicle, leg, planned.platoon)
            found.setdefault(segment, []).append(passage)
    for user in cycle.on_road:
        for segment, (entry, leaving, key) in user.passages():
            if segment in found:
                place = chosen.joined.get(key)
                name = None if place is None else place.platoon
                found[segment].append(_Passage(entry, leaving, user.vehicle, key[1], name))
    return {segment: sorted(passages, key=lambda p: p[:3]) for segment, passages in found.items()}


class _Meeting:
    def __init__(self, cycle: Cycle, chosen: Candidate) -> None:
        self._planner = planner = Planner.of(cycle, ())
        numbers = {vehicle.id: n for n, vehicle in enumerate(cycle.problem.fleet.vehicles)}
        self._routes: Mapping[str, tuple[int, Route]] = {
            route.vehicle: (numbers[route.vehicle], route) for route in chosen.routes
        }
        self._meetings: Meetings = planner.book.meetings()
        for number, route in self._routes.values():
            self._meetings.add(planner.book.traversals(number, route))

    def tried(self, one: RefusedPlatoon, misses: Sequence[_Miss]) -> RefusedPlatoon:
        """The same with what it would cost and save if one of the two moved, as far as it can."""
        if one.detail is not None:
            return one
        closest = min(misses, key=lambda miss: miss.first.entry_s)
        apart_s = closest.second.entry_s - closest.first.entry_s
        best: tuple[float, float] | None = None
        moves = ((closest.first, apart_s), (closest.second, -apart_s))
        for passage, shift_s in moves:
            for cost_kwh, saving_kwh in self._changes(passage, shift_s):
                if best is None or saving_kwh - cost_kwh > best[1] - best[0]:
                    best = cost_kwh, saving_kwh
        if best is None:
            return one
        cost_kwh, saving_kwh = best
        reason: RefusalReason = "not_worth" if saving_kwh <= cost_kwh + 1e-9 else "missed"
        return replace(one, reason=reason, cost_kwh=cost_kwh, saving_kwh=saving_kwh)

    def _changes(self, passage: _Passage, shift_s: float) -> Iterator[tuple[float, float]]:
        """(cost, savings), kWh, of each way to shift a free vehicle's passage."""
        number, route = self._routes.get(passage.vehicle, (-1, None))
        if route is None or number in self._planner.windows.bound:
            return
        stops = tuple(visit.place for visit in route.visits[1:-1])
        waits_s = tuple(visit.wait_s for visit in route.visits[1:-1])
        depart_s = route.visits[0].departure_s

        def moved(depart_s: float, waits_s: Sequence[float]) -> Itinerary | None:
            return self._planner.itinerary(number, stops, route.legs, depart_s, waits_s)

        present = moved(depart_s, waits_s)
        if present is None:
            return
        self._meetings.remove(present.traversals)
        tried: Iterable[Itinerary | None] = [
            moved(depart_s + shift_s, waits_s),
            *(
                moved(depart_s, (*waits_s[:at], waits_s[at] + shift_s, *waits_s[at + 1 :]))
                for at in range(passage.leg if self._planner.problem.waits_on_tours else 0)
                if 0.0 <= waits_s[at] + shift_s <= MAX_WAIT_S
            ),
        ]
        options = [present, *(one for one in tried if one is not None)]
        gains_kwh = self._meetings.gains_kwh(option.traversals for option in options)
        self._meetings.add(present.traversals)
        for option, gain_kwh in zip(options[1:], gains_kwh[1:], strict=True):
            yield option.cost_kwh - present.cost_kwh, gain_kwh - gains_kwh[0]

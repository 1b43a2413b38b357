"""Platoons on segments, from exact times."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from dispatcher_daemon.fleet import Passage
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.platooning.expected import ExpectedDrafting
from dispatcher_daemon.planning.platooning.reductions import planned_reductions
from dispatcher_daemon.planning.roads import RoadLeg, Route
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.energy.consumption import ETA_ALONE

Key = TypeVar("Key", bound=tuple[Any, ...])
TimedPassage = tuple[float, float, Key]
"""(entry, leaving, passage) on one segment, s; a passage begins with its vehicle."""
_ROUNDING_S: Final = 1e-3


@dataclass(frozen=True)
class Place:
    """A vehicle's place in a platoon.

    Attributes:
        number: 0 is the leader.
        members: of the platoon, at least two.
        share: of the segment, on which it is expected to be close.
    """

    platoon: str
    number: int
    members: int
    share: float = 1.0


def form_platoons(
    routes: Sequence[Route],
    snapshot: TrafficSnapshot,
    sync_window_s: float,
    longest: int,
    cycle: int,
    on_road: Iterable[tuple[str, TimedPassage[Passage]]] = (),
    expected: ExpectedDrafting | None = None,
) -> dict[Passage, Place]:
    """Platoons of finished routes.

    On a segment whose gate is open, vehicles that enter within the window after the first of them
    drive as its platoon, in the order of their entries. They must also be due to leave it within
    the window and in that order: a vehicle that starts from a stop at its beginning falls behind.

    Args:
        longest: number of vehicles that a platoon has at most.
        on_road: passages of vehicles on the road, each with its segment.

    Returns:
        Places of all passages in a platoon; vehicles alone are left out. A platoon keeps its name
        from segment to segment.
    """
    passages: dict[str, list[tuple[float, float, Passage]]] = {}
    for route in routes:
        for leg, position, segment, entry, leaving in route.entries_s():
            if snapshot.segments[segment].open:
                passage = (route.vehicle, leg, position)
                passages.setdefault(segment, []).append((entry, leaving, passage))
    sent = {route.vehicle for route in routes}
    for segment, timed in on_road:
        if segment in passages and snapshot.segments[segment].open:
            passages[segment].append(timed)
    names: dict[tuple[str, ...], str] = {}
    places: dict[Passage, Place] = {}
    approaches = {} if expected is None else expected.of_routes(routes)
    for segment in sorted(passages):
        for group in platoons_of(sorted(passages[segment]), sync_window_s, longest):
            members = tuple(passage[0] for _, _, passage in group)
            if len(group) < 2 or sent.isdisjoint(members):
                continue
            name = names.setdefault(members, f"c{cycle}-p{len(names) + 1}")
            close = (1.0,) * len(group)
            if expected is not None:
                close = expected.shares(tuple(approaches[passage] for _, _, passage in group))
            for number, (share, (_, _, passage)) in enumerate(zip(close, group, strict=True)):
                places[passage] = Place(name, number, len(group), share)
    return places


def platoons_of(
    passages: Sequence[TimedPassage[Key]], sync_window_s: float, longest: int
) -> Iterator[Sequence[TimedPassage[Key]]]:
    """Split the passages of one segment into platoons; those of one vehicle drive alone.

    Args:
        passages: in the order of entry.
        longest: number of vehicles that a platoon has at most.
    """
    at = 0
    while at < len(passages):
        at, groups = independent_groups(passages, at, sync_window_s)
        for group in groups:
            yield from parted(group, longest)


def parted(
    group: Sequence[TimedPassage[Key]], longest: int
) -> Iterator[Sequence[TimedPassage[Key]]]:
    """Platoons of vehicles that drive behind each other: whom a full one has no place for leads the
    next one, as vehicles on the road do it.
    """
    for begin in range(0, len(group), longest):
        yield group[begin : begin + longest]


def independent_groups(
    passages: Sequence[TimedPassage[Key]], at: int, sync_window_s: float
) -> tuple[int, list[list[TimedPassage[Key]]]]:
    """(position of the next passage, groups of any length that `parted` makes platoons of) of a
    stretch from a passage on, up to where no group of it reaches: what changes behind one stretch
    changes nothing in it, nor the reverse.
    """
    # Those that groups before them left behind, then the others from `at` on.
    left, groups = [passages[at]], []
    at += 1
    while left:
        lead_entry = left[0][0]
        end = bisect_left(passages, (lead_entry + sync_window_s + _ROUNDING_S,), at)
        while end > at and passages[end - 1][0] - lead_entry > sync_window_s:
            end -= 1
        left += passages[at:end]
        at = end
        if len(left) == 1:
            groups.append(left)
            break
        group, behind = _joined(left, sync_window_s)
        vehicles = {passage[0] for _, _, passage in group}
        if len(vehicles) < len(group):
            group, behind = _joined(left, sync_window_s, each_once=True)
        groups.append(group)
        left = behind
    return at, groups


def _joined(
    passages: Sequence[TimedPassage[Key]], sync_window_s: float, *, each_once: bool = False
) -> tuple[list[TimedPassage[Key]], list[TimedPassage[Key]]]:
    """(the group that the first of some passages leads, those that it leaves behind).

    Args:
        each_once: whether a vehicle that passes again is left behind.
    """
    group, behind = [passages[0]], []
    last_leaving = passages[0][1]
    latest_leaving, vehicles = last_leaving + sync_window_s, {passages[0][2][0]}
    for candidate in passages[1:]:
        leaving = candidate[1]
        if last_leaving <= leaving <= latest_leaving:
            if each_once:
                if candidate[2][0] in vehicles:
                    behind.append(candidate)
                    continue
                vehicles.add(candidate[2][0])
            group.append(candidate)
            last_leaving = leaving
        else:
            behind.append(candidate)
    return group, behind


def drag_reductions(
    problem: RoutingProblem, route: Route, places: Mapping[Passage, Place]
) -> list[list[float]]:
    """η_drag on each segment of each leg, by place and by the gap at the mean speed there, times
    the share of it on which the platoon is expected to be close; 0 alone.

    By the paper's law 0.05 in front and 0.20 behind (II-B).
    """
    profile = problem.profile_of(route.vehicle)

    def eta(number: int, leg: RoadLeg, position: int) -> float:
        place = places.get((route.vehicle, number, position))
        if place is None:
            return ETA_ALONE
        drive = leg.drive
        entry_s = drive.unhindered_s() if drive.waiting_s else drive.entry_s
        times_s = (*entry_s, drive.times_s[-1])
        length_m = problem.network.segments[leg.path[position]].length_m
        speed_mps = length_m / (times_s[position + 1] - times_s[position])
        reductions = planned_reductions(problem, profile, speed_mps)
        return place.share * reductions.at(place.number, place.members)

    return [
        [eta(number, leg, position) for position in range(len(leg.path))]
        for number, leg in enumerate(route.legs)
    ]

"""What is expected of planned platoons, by the ways on which their vehicles have come together.

The law is in `dispatcher_daemon.planning.platooning.closing_up`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import lru_cache
from itertools import pairwise
from types import MappingProxyType
from typing import Final, NamedTuple

from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.platooning.closing_up import (
    CLOSE,
    STARTING,
    Courses,
    SegmentGaps,
    meeting,
    onward,
)
from dispatcher_daemon.planning.roads import RoadLeg, Route, planning_speed_mps
from dispatcher_daemon.traffic import TrafficSnapshot

LegFrom = tuple[str, tuple[str, ...]]
"""Node of the place that a vehicle left, and its path from there, or from where it was later on."""
Approach = int
"""How a vehicle comes to a segment: a number for the way from where it started up to there."""

_FROM_REST: Final[Approach] = -1
_UNDER_WAY: Final[Approach] = -2
_GROUPS: Final = 1 << 17


class _Node(NamedTuple):
    """The way of a vehicle up to a segment.

    Attributes:
        before: the segment before, or where it started.
        courses: of two that have come all this way together.
        unstopped: chance that no signal has stopped one vehicle on it.
    """

    segment: str
    before: Approach
    courses: Courses
    way_m: float
    unstopped: float


class ExpectedDrafting:
    """Shares of segments on which planned platoons are expected to be close.

    Whether a gate is open counts as it is now; what vehicles that are under way have behind them
    counts from where their present plans begin, and as closed up before.
    """

    def __init__(
        self,
        problem: RoutingProblem,
        snapshot: TrafficSnapshot,
        begun: Mapping[str, LegFrom] = MappingProxyType({}),
        on_road: Mapping[tuple[str, int], LegFrom] = MappingProxyType({}),
    ) -> None:
        """Start without any approach.

        Args:
            begun: what lies behind vehicles whose routes begin under way, in the first leg; at
                least the segment that they are on, which is the last one.
            on_road: legs, by number, of vehicles that the cycle does not plan.
        """
        self._problem, self._snapshot = problem, snapshot
        self._nodes: list[_Node] = []
        self._number: dict[tuple[Approach, str], Approach] = {}
        self._gaps: dict[str, SegmentGaps] = {}
        self._of_legs: dict[tuple[Approach, tuple[str, ...]], tuple[Approach, ...]] = {}
        self._met: dict[tuple[Approach, Approach], tuple[float, Courses]] = {}
        self._begins = {vehicle: self._place(leg) for vehicle, leg in begun.items()}
        self.on_road: Mapping[tuple[str, int, int], Approach] = {
            (vehicle, number, position): approach
            for (vehicle, number), leg in on_road.items()
            for position, approach in enumerate(self.along(leg[1], self._start(leg)))
        }
        self.shares = lru_cache(_GROUPS)(self._shares)

    def of_leg(self, vehicle: str, number: int, leg: RoadLeg) -> tuple[Approach, ...]:
        """Approaches to all segments of a leg of a route."""
        start = self.start_of(vehicle, number)
        if (start, leg.path) not in self._of_legs:
            self._of_legs[start, leg.path] = self.along(leg.path, start)
        return self._of_legs[start, leg.path]

    def start_of(self, vehicle: str, number: int) -> Approach:
        """What lies behind a vehicle where a leg of its route begins."""
        return self._begins.get(vehicle, _FROM_REST) if number == 0 else _FROM_REST

    def of_routes(self, routes: Iterable[Route]) -> dict[tuple[str, int, int], Approach]:
        """Approaches by passage (vehicle, leg, position), those of vehicles on the road as well."""
        return {
            **self.on_road,
            **{
                (route.vehicle, number, position): approach
                for route in routes
                for number, leg in enumerate(route.legs)
                for position, approach in enumerate(self.of_leg(route.vehicle, number, leg))
            },
        }

    def _shares(self, approaches: tuple[Approach, ...]) -> tuple[float, ...]:
        """Share of a segment on which each place of a platoon saves, in [0, 1].

        Args:
            approaches: of its vehicles to the segment, at least two, the leader's first.
        """
        gaps = self._segment(self._nodes[approaches[0]].segment)
        return gaps.shares([self._together(a, b) for a, b in pairwise(approaches)])

    def _start(self, leg: LegFrom) -> Approach:
        """Where a leg begins: at rest, or under way if its first segment does not begin there."""
        node, path = leg
        first = self._problem.network.segments.get(path[0])
        return _FROM_REST if first is not None and first.start == node else _UNDER_WAY

    def _place(self, leg: LegFrom) -> Approach:
        """Where a route goes on whose vehicle is on a path's last segment: before that."""
        start = self._start(leg)
        return (start, *self.along(leg[1][:-1], start))[-1]

    def along(self, path: Iterable[str], start: Approach = _FROM_REST) -> tuple[Approach, ...]:
        """Approaches to the segments of a path, from rest unless it starts otherwise.

        Plans of before a restart may have segments that the network no longer has: behind one the
        vehicle counts as under way.
        """
        found = []
        for segment in path:
            if segment not in self._problem.network.segments:
                start = _UNDER_WAY
            else:
                if (start, segment) not in self._number:
                    self._number[start, segment] = len(self._nodes)
                    self._nodes.append(self._node(start, segment))
                start = self._number[start, segment]
            found.append(start)
        return tuple(found)

    def _node(self, before: Approach, segment: str) -> _Node:
        if before < 0:
            moving = before == _UNDER_WAY
            way_m = math.inf if moving else 0.0
            return _Node(segment, before, CLOSE if moving else STARTING, way_m, 1.0)
        last = self._nodes[before]
        unstopped = last.unstopped
        if self._at_signal(last.segment):
            unstopped *= 1 - self._snapshot.chance_of_stop(last.segment, segment)
        return _Node(
            segment,
            before,
            self._over(last.courses, last.segment, segment),
            last.way_m + self._problem.network.segments[last.segment].length_m,
            unstopped,
        )

    def _together(self, a: Approach, b: Approach) -> tuple[float, Courses]:
        """(way that two vehicles have come together, m; its possible courses) up to a segment."""
        nodes, way = self._nodes, list[tuple[Approach, Approach]]()
        # Back to where both are known to have come together, or have met.
        while a != b and (a, b) not in self._met:
            way.append((a, b))
            a, b = nodes[a].before, nodes[b].before
            if min(a, b) < 0 or nodes[a].segment != nodes[b].segment:
                a, b = way.pop()
                self._met[a, b] = 0.0, meeting(nodes[a].unstopped * nodes[b].unstopped)
        way_m, courses = (nodes[a].way_m, nodes[a].courses) if a == b else self._met[a, b]
        last = nodes[a].segment
        for pair in reversed(way):
            segment = nodes[pair[0]].segment
            way_m += self._problem.network.segments[last].length_m
            courses, last = self._over(courses, last, segment), segment
            self._met[pair] = way_m, courses
        return way_m, courses

    def _over(self, courses: Courses, segment: str, onto: str) -> Courses:
        """What two vehicles have behind them when they come from one segment onto the next."""
        length_m = self._problem.network.segments[segment].length_m
        open_m = length_m if self._snapshot.segments[segment].open else None
        stops = self._snapshot.chance_of_stop(segment, onto)
        return onward(courses, open_m, stops, at_signal=self._at_signal(segment))

    def _at_signal(self, segment: str) -> bool:
        network = self._problem.network
        return network.segments[segment].end in network.signals

    def _segment(self, name: str) -> SegmentGaps:
        if name not in self._gaps:
            segment, profile = self._problem.network.segments[name], self._problem.profiles[0]
            speed = planning_speed_mps(segment, self._snapshot.segments[name], profile)
            self._gaps[name] = SegmentGaps.of(
                segment.length_m, speed, profile, self._problem.advised_gap_m
            )
        return self._gaps[name]

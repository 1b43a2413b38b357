"""What is expected of platoons: the share of a segment on which vehicles that are planned together
drive close.

**Closing up.** Vehicles that start together enter the road T apart (`ENTRY_HEADWAY_S`), and behind
a segment with a closed gate they have drivers' gaps. With g* the wanted gap, at a speed v each gap
is too large by

    a = v T − g*         from rest, or from where two ways meet
    b = g_driver − g*    from a closed gate on

The leader waits: it is slower by u = 0.15 v, and changes its speed by c, 0.9 of coasting. Gaps that
are too large by E in all are closed in t = E/u + u/c, or in t = 2 √(E/c) where it does not get to u
(E < u²/c), and on x(E) = v t of the follower's way. With k gaps ahead of the k-th follower, its own
included, and z_a and z_b the open road since they were a and b, it is close from

    max(x(k a) − z_a, x(k b) − z_b, 0)

on. What is not closed at a segment's end is carried over in z. Gaps that had come about before its
own did are not among the k of a: they are closed.

**Signals.** A vehicle stops before a junction with a chance p, its expected stops there. Two that
come over the same segment, T apart, are parted by a signal if its green ends between them, once in
a cycle C: they stay together with 1 − T/C. Where both stop, they start from rest again. Phases that
two find at signals on different ways are independent, and a stop is longer than the window: they
meet behind these with the chance that none of both has stopped, Π (1 − p).

A platoon saves, at each place, the ideal saving times this share; the leader that of its first
follower.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from types import MappingProxyType
from typing import Final, NamedTuple

from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads import Leg, Route, planning_speed_mps
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.spacing import (
    ENTRY_HEADWAY_S,
    MAX_SLOWDOWN,
    SLOWING_SHARE,
    driver_gap_m,
    wanted_gap_m,
)
from slipstream.traction import coasting_mps2

SIGNAL_CYCLE_S: Final = 90.0
"""C: what SUMO's and many real signals have; only its ratio to the headway counts."""

LegFrom = tuple[str, tuple[str, ...]]
"""Node of the place that a vehicle left, and its path from there, or from where it was later on."""
Approach = int
"""How a vehicle comes to a segment: a number for the way from where it started up to there."""

_FROM_REST: Final[Approach] = -1
_UNDER_WAY: Final[Approach] = -2
_NO_STOP: Final = 1e-3
_GROUPS: Final = 1 << 17


def closing_way_m(open_m: float, speed_mps: float, coasting: float) -> float:
    """x(E): see the module, m.

    Args:
        open_m: E, by how much the gaps ahead are too large in all, m.
        speed_mps: v > 0.
        coasting: the leader's deceleration without traction and brake, m/s², > 0.
    """
    if open_m <= 0:
        return 0.0
    slower_mps, slowing = MAX_SLOWDOWN * speed_mps, SLOWING_SHARE * coasting
    if open_m >= slower_mps**2 / slowing:
        return speed_mps * (open_m / slower_mps + slower_mps / slowing)
    return speed_mps * 2 * math.sqrt(open_m / slowing)


class Together(NamedTuple):
    """What two vehicles that come to a segment together have behind them, in one possible course.

    Attributes:
        chance: of it.
        since_rest_m: z_a, open road since their gap was that of the entry.
        since_gate_m: z_b, open road since the last closed gate; inf: none.
    """

    chance: float
    since_rest_m: float
    since_gate_m: float


_STARTING: Final = Together(1.0, 0.0, math.inf)
_CLOSE: Final = Together(1.0, math.inf, math.inf)


class SegmentGaps(NamedTuple):
    """The quantities of one segment that the law needs.

    Attributes:
        length_m: its length.
        speed_mps: v.
        coasting: at v, m/s².
        entry_m: a.
        gate_m: b.
    """

    length_m: float
    speed_mps: float
    coasting: float
    entry_m: float
    gate_m: float

    def close_share(self, gaps: int, all_gaps: int, behind: Together) -> float:
        """Share of the segment on which a follower is close in one course.

        Args:
            gaps: k, those ahead that were open together with its own.
            all_gaps: its place, the gaps ahead that a closed gate opened.
        """
        rest_m = closing_way_m(gaps * self.entry_m, self.speed_mps, self.coasting)
        gate_m = closing_way_m(all_gaps * self.gate_m, self.speed_mps, self.coasting)
        open_m = max(rest_m - behind.since_rest_m, gate_m - behind.since_gate_m, 0.0)
        return max(0.0, 1 - open_m / self.length_m)


class _Node(NamedTuple):
    """The way of a vehicle up to a segment.

    Attributes:
        segment: that it comes to.
        before: the segment before, or where it started.
        courses: of two that have come all this way together; the first without a stop on it.
        way_m: they have done together.
        unstopped: chance that no signal has stopped one vehicle on it.
    """

    segment: str
    before: Approach
    courses: tuple[Together, ...]
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
        self._met: dict[tuple[Approach, Approach], tuple[float, tuple[Together, ...]]] = {}
        self._begins = {vehicle: self._place(leg) for vehicle, leg in begun.items()}
        self.on_road: Mapping[tuple[str, int, int], Approach] = {
            (vehicle, number, position): approach
            for (vehicle, number), leg in on_road.items()
            for position, approach in enumerate(self.along(leg[1], self._start(leg)))
        }
        self.shares = lru_cache(_GROUPS)(self._shares)

    def of_leg(self, vehicle: str, number: int, leg: Leg) -> tuple[Approach, ...]:
        """Approaches to all segments of a leg of a route.

        Args:
            number: of the leg in the route.
        """
        start = self._begins.get(vehicle, _FROM_REST) if number == 0 else _FROM_REST
        if (start, leg.path) not in self._of_legs:
            self._of_legs[start, leg.path] = self.along(leg.path, start)
        return self._of_legs[start, leg.path]

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
        pairs = [self._together(a, b) for a, b in pairwise(approaches)]
        followers = []
        for number, (way_m, (unstopped, *stopped)) in enumerate(pairs, 1):
            as_new = sum(other_m <= way_m for other_m, _ in pairs[:number])
            share = unstopped.chance * gaps.close_share(as_new, number, unstopped)
            share += sum(c.chance * gaps.close_share(number, number, c) for c in stopped)
            followers.append(share)
        return (followers[0], *followers)

    def _start(self, leg: LegFrom) -> Approach:
        """Where a leg begins: at rest, or under way if its first segment does not begin there."""
        node, path = leg
        return _FROM_REST if self._problem.network.segments[path[0]].start == node else _UNDER_WAY

    def _place(self, leg: LegFrom) -> Approach:
        """Where a route goes on whose vehicle is on a path's last segment: before that."""
        start = self._start(leg)
        return (start, *self.along(leg[1][:-1], start))[-1]

    def along(self, path: Iterable[str], start: Approach = _FROM_REST) -> tuple[Approach, ...]:
        """Approaches to the segments of a path, from rest unless it starts otherwise."""
        found = []
        for segment in path:
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
            return _Node(segment, before, (_CLOSE if moving else _STARTING,), way_m, 1.0)
        last = self._nodes[before]
        stops = self._chance_of_stop(last.segment, segment)
        at_signal = self._at_signal(last.segment)
        return _Node(
            segment,
            before,
            self._over(last.courses, last.segment, segment),
            last.way_m + self._problem.network.segments[last.segment].length_m,
            last.unstopped * (1 - stops if at_signal else 1.0),
        )

    def _together(self, a: Approach, b: Approach) -> tuple[float, tuple[Together, ...]]:
        """(way that two vehicles have come together, m; its possible courses) up to a segment."""
        nodes, way = self._nodes, list[tuple[Approach, Approach]]()
        # Back to where both are known to have come together, or have met.
        while a != b and (a, b) not in self._met:
            way.append((a, b))
            a, b = nodes[a].before, nodes[b].before
            if min(a, b) < 0 or nodes[a].segment != nodes[b].segment:
                a, b = way.pop()
                chance = nodes[a].unstopped * nodes[b].unstopped
                self._met[a, b] = 0.0, (_STARTING._replace(chance=chance),)
        way_m, courses = (nodes[a].way_m, nodes[a].courses) if a == b else self._met[a, b]
        last = nodes[a].segment
        for pair in reversed(way):
            segment = nodes[pair[0]].segment
            way_m += self._problem.network.segments[last].length_m
            courses, last = self._over(courses, last, segment), segment
            self._met[pair] = way_m, courses
        return way_m, courses

    def _over(self, courses: Sequence[Together], segment: str, onto: str) -> tuple[Together, ...]:
        """What two vehicles have behind them when they come from one segment onto the next."""
        if self._snapshot.segments[segment].open:
            length_m = self._problem.network.segments[segment].length_m
            after = [
                Together(c.chance, c.since_rest_m + length_m, c.since_gate_m + length_m)
                for c in courses
            ]
        else:
            after = [c._replace(since_gate_m=0.0) for c in courses]
        stops = self._chance_of_stop(segment, onto)
        if stops < _NO_STOP:
            return tuple(after)
        kept = 1 - ENTRY_HEADWAY_S / SIGNAL_CYCLE_S if self._at_signal(segment) else 1.0
        stopped = kept * stops * sum(c.chance for c in after)
        going = [c._replace(chance=kept * (1 - stops) * c.chance) for c in after]
        likely = [c for c in going[1:] if c.chance >= _NO_STOP]
        return going[0], *likely, _STARTING._replace(chance=stopped)

    def _chance_of_stop(self, segment: str, onto: str) -> float:
        return self._snapshot.chance_of_stop(segment, onto)

    def _at_signal(self, segment: str) -> bool:
        network = self._problem.network
        return network.segments[segment].end in network.signals

    def _segment(self, name: str) -> SegmentGaps:
        if name not in self._gaps:
            segment, profile = self._problem.network.segments[name], self._problem.profiles[0]
            speed = planning_speed_mps(segment, self._snapshot.segments[name], profile)
            wanted_m = wanted_gap_m(speed, self._problem.advised_gap_m)
            self._gaps[name] = SegmentGaps(
                segment.length_m,
                speed,
                coasting_mps2(speed, profile.physics),
                max(0.0, speed * ENTRY_HEADWAY_S - wanted_m),
                max(0.0, driver_gap_m(speed) - wanted_m),
            )
        return self._gaps[name]

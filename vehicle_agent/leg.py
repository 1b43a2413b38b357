"""One leg of a plan, from rest to rest: its road ahead, and where the vehicle is on it."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from slipstream.messages import PlannedSegment, VehicleSensing

YIELDING_MPS: Final = 4.0
"""Entry speed where one must give way: crossing traffic is seen some metres before the line, and
√(2 · 2.5 m/s² · 4.5 m) = 4.7 m/s still stops there, less what a control interval takes."""


@dataclass(frozen=True)
class VehicleState:
    """Where a vehicle is on its leg, and how it moves.

    Attributes:
        segment: of its path that it is on, or that it has just left while it crosses a junction.
        number: of that segment in the path.
        crossing: whether it is in a junction, between that segment and the next one.
        front_m: of its front, along the segment, or along the lane through the junction.
    """

    segment: str
    number: int
    crossing: bool
    lane: int
    front_m: float
    speed_mps: float
    acceleration_mps2: float = 0.0


@dataclass(frozen=True)
class SlowPoint:
    """A place along the leg that may not be passed faster than this; 0: the leg's end."""

    at_m: float
    speed_mps: float


@dataclass(frozen=True)
class StopLine:
    """A signal's stop line on a leg.

    Attributes:
        number: of the segment in the path whose end it stands at.
        at_m: along the leg.
        groups: signal group by lane, of the lanes that lead on.
        passing_mps: allowed behind it, on the way through the junction.
    """

    number: int
    at_m: float
    intersection: str
    groups: Mapping[int, int]
    passing_mps: float

    def group(self, lane: int | None) -> int:
        """The signal group of a lane; that of the nearest lane that leads on, if it does not."""
        wanted = 0 if lane is None else lane
        return self.groups[min(self.groups, key=lambda other: (abs(other - wanted), other))]


@dataclass(frozen=True)
class Leg:
    """The road of a plan's leg: its segments in order, at least one, measured from the begin of the
    first, junctions included. The vehicle itself drives no faster than `max_speed_mps`.
    """

    cycle: int
    number: int
    planned: tuple[PlannedSegment, ...]
    max_speed_mps: float = math.inf

    @cached_property
    def path(self) -> tuple[str, ...]:
        """Its segments' ids."""
        return tuple(segment.segment for segment in self.planned)

    @cached_property
    def numbers(self) -> Mapping[str, int]:
        """Number of each segment in the path, the last one of those that it drives twice."""
        return {segment: number for number, segment in enumerate(self.path)}

    @cached_property
    def lengths_m(self) -> tuple[float, ...]:
        """Of its segments."""
        return tuple(_known(segment.length_m) for segment in self.planned)

    @cached_property
    def limits_mps(self) -> tuple[float, ...]:
        """What may be driven on its segments: the speed limit, or the vehicle's own."""
        own = self.max_speed_mps
        return tuple(min(own, _known(segment.speed_limit_mps)) for segment in self.planned)

    @cached_property
    def begins_m(self) -> tuple[float, ...]:
        """Where each segment begins."""
        begins, at = [], 0.0
        for length_m, segment in zip(self.lengths_m, self.planned, strict=True):
            begins.append(at)
            at += length_m + (0.0 if segment.crossing is None else segment.crossing.length_m)
        return tuple(begins)

    @cached_property
    def ends_m(self) -> tuple[float, ...]:
        """Where each segment ends."""
        return tuple(b + length for b, length in zip(self.begins_m, self.lengths_m, strict=True))

    @property
    def length_m(self) -> float:
        """Of the whole leg."""
        return self.ends_m[-1]

    @cached_property
    def slow(self) -> tuple[SlowPoint, ...]:
        """Places where speed must be lower than just before, in order; the last is the end."""
        found = []
        for i, (segment, limit) in enumerate(zip(self.planned, self.limits_mps, strict=True)):
            crossing = segment.crossing
            if i + 1 == len(self.planned):
                break
            allowed = limit if crossing is None else crossing.speed_mps
            passing = min(allowed, YIELDING_MPS) if crossing and crossing.yields else allowed
            if passing < limit:
                found.append(SlowPoint(self.ends_m[i], passing))
            if self.limits_mps[i + 1] < min(limit, allowed):
                found.append(SlowPoint(self.begins_m[i + 1], self.limits_mps[i + 1]))
        return (*found, SlowPoint(self.length_m, 0.0))

    @cached_property
    def lines(self) -> tuple[StopLine, ...]:
        """Stop lines of signals, in order."""
        found = []
        for i, segment in enumerate(self.planned[:-1]):
            crossing = segment.crossing
            if crossing is not None and crossing.intersection is not None:
                passing = min(self.limits_mps[i], crossing.speed_mps)
                groups = dict(crossing.signal_groups)
                found.append(StopLine(i, self.ends_m[i], crossing.intersection, groups, passing))
        return tuple(found)

    def place_m(self, state: VehicleState) -> float:
        """Where a vehicle's front is along the leg."""
        if state.crossing:
            return self.ends_m[state.number] + state.front_m
        return self.begins_m[state.number] + state.front_m

    def slow_ahead(self, place_m: float) -> tuple[SlowPoint, ...]:
        """The places ahead where speed must be lower."""
        return self.slow[bisect_right(self.slow, place_m, key=lambda slow: slow.at_m) :]

    def next_line(self, place_m: float) -> StopLine | None:
        """The next stop line ahead; None: none is left."""
        return next((line for line in self.lines if line.at_m > place_m), None)

    def locate(self, sensing: VehicleSensing, at_least: int = 0) -> VehicleState | None:
        """Where a vehicle is on the leg, from the segment numbered `at_least` on, for it never
        drives back; None: it is not on its path.
        """
        try:
            number = self.path.index(sensing.segment, at_least)
        except ValueError:
            return None
        return VehicleState(
            sensing.segment,
            number,
            sensing.crossing,
            sensing.lane,
            sensing.front_m,
            sensing.speed_mps,
            sensing.acceleration_mps2,
        )


def legs_of(
    cycle: int,
    segments: Sequence[PlannedSegment],
    count: int,
    max_speed_mps: float = math.inf,
) -> tuple[Leg | None, ...]:
    """The legs of a plan, one less than its stops; None for one without a road, between two places
    at one junction.
    """
    parts: list[list[PlannedSegment]] = [[] for _ in range(count)]
    for segment in segments:
        parts[segment.leg].append(segment)
    return tuple(
        Leg(cycle, i, tuple(part), max_speed_mps) if part else None for i, part in enumerate(parts)
    )


def _known(value: float | None) -> float:
    """A value that a plan must have to be driven by.

    Raises:
        ValueError: it has not; the plan is of a dispatcher before this version.
    """
    if value is None:
        raise ValueError("the plan has no lengths or limits")
    return value

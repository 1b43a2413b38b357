"""What was driven by the plans in force: energy and way per vehicle and hour, and how it is booked.

A plan is booked segment by segment as its vehicle passes them, so that of a plan that is replaced
only what lies before the replacement counts. The progress of a vehicle is a number of segments of
its plan: 3.4 is four tenths of the fourth one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from math import fsum
from typing import Final

from slipstream.messages import PlannedSegment, VehiclePlan

HOUR_NS: Final = 3600 * 10**9


@dataclass(frozen=True)
class PlanEnergy:
    """What a plan needs on its way, and saves against its vehicle's part of the cycle's baseline.

    Attributes:
        driven_kwh: on each segment, with what its platoons are expected to save.
        saved_drag_kwh: by these platoons, on each segment.
        saved_distance_kwh: of the whole plan, by its way and speeds; see
            `slipstream.energy.consumption.split_saving`.
        saved_acceleration_kwh: of the whole plan, by its speed changes.
        begin: share of the first segment that lay behind the vehicle, of which the plan needs
            nothing.
    """

    driven_kwh: tuple[float, ...]
    saved_drag_kwh: tuple[float, ...]
    saved_distance_kwh: float = 0.0
    saved_acceleration_kwh: float = 0.0
    begin: float = 0.0

    @property
    def drafting_kwh(self) -> float:
        """What platoons save of the same drive alone."""
        return fsum(self.saved_drag_kwh)


@dataclass(frozen=True)
class EnergyHour:
    """What one vehicle has driven in one hour by the plans in force.

    The saved parts add up to the baseline's energy less the plans'.

    Attributes:
        hour_ns: begin of the hour, UTC.
        vehicle: its id.
        baseline_kwh: what the plans' cycles say that the baseline would have needed.
        plan_kwh: by the plans, with what platoons were expected to save.
        saved_distance_kwh: see `slipstream.energy.consumption.split_saving`.
        saved_drag_kwh: likewise.
        saved_acceleration_kwh: likewise.
        distance_m: way.
        platooned_m: part of it in close platoons, as expected.
    """

    hour_ns: int
    vehicle: str
    baseline_kwh: float
    plan_kwh: float
    saved_distance_kwh: float
    saved_drag_kwh: float
    saved_acceleration_kwh: float
    distance_m: float
    platooned_m: float


@dataclass(frozen=True)
class EnergySum:
    """The same of all vehicles in an hour, a day, or any time that begins at ``begin_ns``."""

    begin_ns: int
    baseline_kwh: float
    plan_kwh: float
    saved_distance_kwh: float
    saved_drag_kwh: float
    saved_acceleration_kwh: float
    distance_m: float
    platooned_m: float


FIGURES: Final = tuple(field.name for field in fields(EnergySum))[1:]
"""The fields that both have."""


def merged(parts: Iterable[EnergyHour]) -> list[EnergyHour]:
    """Parts of the same hour and vehicle as one, by hour and vehicle."""
    sums: dict[tuple[int, str], list[float]] = {}
    for part in parts:
        row = sums.setdefault((part.hour_ns, part.vehicle), [0.0] * len(FIGURES))
        for place, name in enumerate(FIGURES):
            row[place] += getattr(part, name)
    return [EnergyHour(*key, *row) for key, row in sorted(sums.items())]


def driven(
    plan: VehiclePlan, energy: PlanEnergy, begin: float, end: float, now_ns: int
) -> Iterator[EnergyHour]:
    """What a vehicle has driven between two progresses on its plan, in parts of one segment each.

    A part counts in the hour of its planned end, or of ``now_ns`` if that is earlier. Drafting is
    saved where it is planned; what else is saved has no place, and is spread over the way by its
    length.

    Args:
        plan: with lengths of its segments.
        begin: up to where it was booked before.
        end: to be booked up to.
    """
    first = max(begin, energy.begin)
    whole_m = fsum(_length_m(s) for s in plan.segments)
    whole_m -= energy.begin * _length_m(plan.segments[0]) if plan.segments else 0.0
    for number in range(int(first), len(plan.segments)):
        segment, starts = plan.segments[number], max(float(number), energy.begin)
        passed = min(end, number + 1.0) - max(first, starts)
        if passed <= 0:
            return
        # Of what the plan needs there: its first segment may lie behind in part.
        share = passed / (number + 1 - starts)
        length_m = passed * _length_m(segment)
        of_way = length_m / whole_m if whole_m > 0 else 0.0
        plan_kwh = share * energy.driven_kwh[number]
        drag_kwh = share * energy.saved_drag_kwh[number]
        distance_kwh = of_way * energy.saved_distance_kwh
        acceleration_kwh = of_way * energy.saved_acceleration_kwh
        close = 0.0 if segment.platoon is None else segment.drafting_share or 0.0
        ended_ns = min(segment.exit_ns, now_ns)
        yield EnergyHour(
            hour_ns=ended_ns - ended_ns % HOUR_NS,
            vehicle=plan.vehicle,
            baseline_kwh=plan_kwh + drag_kwh + distance_kwh + acceleration_kwh,
            plan_kwh=plan_kwh,
            saved_distance_kwh=distance_kwh,
            saved_drag_kwh=drag_kwh,
            saved_acceleration_kwh=acceleration_kwh,
            distance_m=length_m,
            platooned_m=close * length_m,
        )


def replaced_at(plan: VehiclePlan, later: VehiclePlan, begin: float, leg: int) -> float | None:
    """The progress on a plan at which a later one begins; None: it begins on another way.

    Args:
        plan: that the vehicle has followed.
        later: its next version, which begins with the place that the vehicle left last.
        begin: `PlanEnergy.begin` of that.
        leg: of the plan, the furthest that the vehicle has reported.
    """
    place = later.stops[0].stop
    left = [n for n, stop in enumerate(plan.stops[: leg + 1]) if stop.stop == place]
    if not left:
        return None
    first = sum(segment.leg < left[-1] for segment in plan.segments)
    if not later.segments or later.segments[0].leg > 0:
        return float(first)
    number = index_on_leg(plan.segments, left[-1], later.segments[0].segment, later.depart_ns)
    return None if number is None else number + begin


def index_on_leg(
    segments: Sequence[PlannedSegment], leg: int, segment: str, time_ns: int
) -> int | None:
    """Index of a segment among a plan's, on a leg; None: it is not there. Of passages of the same
    one, the one that begins nearest to a time.
    """
    found = [n for n, s in enumerate(segments) if s.leg == leg and s.segment == segment]
    return min(found, key=lambda n: abs(segments[n].entry_ns - time_ns), default=None)


def _length_m(segment: PlannedSegment) -> float:
    # None has no `PlanEnergy`.
    return segment.length_m or 0.0

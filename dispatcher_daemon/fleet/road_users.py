"""Vehicles that follow plans of earlier cycles: what of their plans lies ahead."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from slipstream.messages import PlannedSegment, VehiclePlan

Passage = tuple[str, int, int]
"""A vehicle's passage of one segment: (vehicle, leg, position in the leg)."""


@dataclass(frozen=True)
class RoadUser:
    """A vehicle that drives by an earlier plan.

    Attributes:
        vehicle: of the fleet; the cycle does not plan it.
        ahead: remaining segments in order: passage of its plan and segment, with times in UTC.
        legs: of its plan by number: node of the place that it left, and path.
    """

    vehicle: str
    now_ns: int
    ahead: tuple[tuple[Passage, PlannedSegment], ...]
    legs: Mapping[int, tuple[str, tuple[str, ...]]] = field(default_factory=dict)
    cycle: int = 0
    late_s: float = 0.0

    def passages(self) -> Iterator[tuple[str, tuple[float, float, Passage]]]:
        """Each segment with entry, leaving and passage, times in s after the cycle's start."""
        for passage, planned in self.ahead:
            entry, leaving = planned.entry_ns - self.now_ns, planned.exit_ns - self.now_ns
            yield planned.segment, (1e-9 * entry, 1e-9 * leaving, passage)


def on_road(
    plans: Iterable[VehiclePlan], now_ns: int, late_s: Mapping[str, float] | None = None
) -> tuple[RoadUser, ...]:
    """The vehicles of earlier plans that still have segments to enter after a moment."""
    late = late_s or {}
    users = []
    for plan in sorted(plans, key=lambda plan: plan.vehicle):
        late_by_s = late.get(plan.vehicle, 0.0)
        shifts_ns = _shifts_ns(plan, round(1e9 * late_by_s), now_ns)
        paths: dict[int, list[str]] = {}
        ahead = []
        for planned in plan.segments:
            shift_ns, path = shifts_ns[planned.leg], paths.setdefault(planned.leg, [])
            passage = plan.vehicle, planned.leg, len(path)
            path.append(planned.segment)
            if planned.entry_ns + shift_ns > now_ns:
                times = {
                    "entry_ns": planned.entry_ns + shift_ns,
                    "exit_ns": planned.exit_ns + shift_ns,
                }
                ahead.append((passage, planned.model_copy(update=times)))
        if ahead:
            legs = {leg: (plan.stops[leg].node, tuple(path)) for leg, path in paths.items()}
            user = RoadUser(plan.vehicle, now_ns, tuple(ahead), legs, plan.cycle, late_by_s)
            users.append(user)
    return tuple(users)


def _shifts_ns(plan: VehiclePlan, late_ns: int, now_ns: int) -> list[int]:
    """By how much a vehicle is behind its plan on each leg: a wait that lies ahead makes up for it,
    and lets nobody leave early.
    """
    shifts, shift = [], late_ns
    for stop in plan.stops[:-1]:
        if stop.wait_s > 0 and stop.departure_ns > now_ns:
            shift = max(0, shift - round(1e9 * stop.wait_s))
        shifts.append(shift)
    return shifts

"""Vehicles that follow plans of earlier cycles, as possible platoon partners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from dispatcher_daemon.platooning.meetings import Shares, Traversals
from dispatcher_daemon.platooning.platoons import Passage, Place, TimedPassage
from dispatcher_daemon.platooning.stretches import Traversal
from slipstream.messages import PlannedSegment, VehiclePlan


@dataclass(frozen=True)
class RoadUser:
    """A vehicle that drives by an earlier plan.

    Attributes:
        vehicle: of the fleet; the cycle does not plan it.
        now_ns: the cycle's start, UTC.
        ahead: remaining segments in order: passage of its plan and segment, with times in UTC.
    """

    vehicle: str
    now_ns: int
    ahead: tuple[tuple[Passage, PlannedSegment], ...]

    def passages(self) -> Iterator[tuple[str, TimedPassage[Passage]]]:
        """Each segment with its passage, times in s after the cycle's start."""
        for passage, planned in self.ahead:
            entry, leaving = planned.entry_ns - self.now_ns, planned.exit_ns - self.now_ns
            yield planned.segment, (1e-9 * entry, 1e-9 * leaving, passage)


def on_road(
    plans: Iterable[VehiclePlan], now_ns: int, late_s: Mapping[str, float] | None = None
) -> tuple[RoadUser, ...]:
    """The vehicles of earlier plans that still have segments to enter after a moment.

    Args:
        plans: at most one a vehicle.
        now_ns: a cycle's start, UTC.
        late_s: by how much vehicles are behind their plans.
    """
    late = late_s or {}
    users = []
    for plan in sorted(plans, key=lambda plan: plan.vehicle):
        shifts_ns = _shifts_ns(plan, round(1e9 * late.get(plan.vehicle, 0.0)), now_ns)
        position: Counter[int] = Counter()
        ahead = []
        for planned in plan.segments:
            shift_ns = shifts_ns[planned.leg]
            passage = plan.vehicle, planned.leg, position[planned.leg]
            position[planned.leg] += 1
            if planned.entry_ns + shift_ns > now_ns:
                times = {
                    "entry_ns": planned.entry_ns + shift_ns,
                    "exit_ns": planned.exit_ns + shift_ns,
                }
                ahead.append((passage, planned.model_copy(update=times)))
        if ahead:
            users.append(RoadUser(plan.vehicle, now_ns, tuple(ahead)))
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


def traversals_on_road(users: Sequence[RoadUser], shares: Mapping[str, Shares]) -> list[Traversals]:
    """Their passages of open segments, under negative vehicle numbers; the fleet's are ≥ 0."""
    found: list[Traversals] = []
    for number, user in enumerate(users, 1):
        traversals: dict[str, list[Traversal]] = {}
        for segment, (entry, leaving, _) in user.passages():
            if segment in shares:
                traversals.setdefault(segment, []).append((entry, leaving, (-number,)))
        found.append(traversals)
    return found


def joined_segments(
    users: Sequence[RoadUser], places: Mapping[Passage, Place], gap_m: float
) -> list[tuple[str, PlannedSegment]]:
    """Vehicle and segment, with its place in a platoon, of each passage that has one."""
    return [
        (
            user.vehicle,
            planned.model_copy(
                update={
                    "platoon": places[passage].platoon,
                    "place": places[passage].number,
                    "gap_m": gap_m if places[passage].number > 0 else None,
                }
            ),
        )
        for user in users
        for passage, planned in user.ahead
        if passage in places
    ]

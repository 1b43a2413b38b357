"""Which of a cycle's plans go out: a bound vehicle gets a new one only where something changed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from dispatcher_daemon.fleet import Commitment
from dispatcher_daemon.planning.plans.messages import VALID_INTERVALS
from slipstream.messages import PlannedSegment, VehiclePlan

Members = Mapping[tuple[str, str], tuple[str, ...]]
"""Vehicles in their order, by platoon and segment."""


def plans_to_send(
    plans: Sequence[VehiclePlan],
    commitments: Sequence[Commitment],
    sync_window_s: float,
    interval_s: float,
) -> tuple[VehiclePlan, ...]:
    """A cycle's plans without those that say what the vehicle's present plan says.

    A change is one of stops, way or platoon, a time that has moved by more than the synchronisation
    window, a plan that would lapse before the next but one cycle, or a vehicle that has lost its
    plan. Who is in a platoon with a vehicle of a changed plan gets a new one too, as platoons have
    new names.
    """
    bound = {own.vehicle: own for own in commitments}
    before = _members(own.plan for own in commitments)
    now = _members(plans)
    changed = {
        plan.vehicle
        for plan in plans
        if plan.vehicle not in bound
        or _differs(plan, bound[plan.vehicle], now, before, sync_window_s, interval_s)
    }
    spread = True
    while spread:
        partners = {m for members in now.values() for m in members if changed & set(members)}
        spread = not partners <= changed
        changed |= partners
    return tuple(plan for plan in plans if plan.vehicle in changed)


def _differs(
    plan: VehiclePlan,
    own: Commitment,
    now: Members,
    before: Members,
    sync_window_s: float,
    interval_s: float,
) -> bool:
    old = own.plan
    ends_ns = plan.issued_ns + round(1e9 * VALID_INTERVALS * interval_s)
    if own.lost or old.valid_until_ns < ends_ns:
        return True
    if len(old.stops) < len(plan.stops) or len(old.segments) < len(plan.segments):
        return True
    stops = old.stops[len(old.stops) - len(plan.stops) + 1 :]
    segments = old.segments[len(old.segments) - len(plan.segments) :]
    if [s.stop for s in stops] != [s.stop for s in plan.stops[1:]]:
        return True
    if [s.segment for s in segments] != [s.segment for s in plan.segments]:
        return True
    limit_ns = 1e9 * sync_window_s
    moved = [abs(a.exit_ns - b.exit_ns) for a, b in zip(segments, plan.segments, strict=True)]
    moved += [abs(a.arrival_ns - b.arrival_ns) for a, b in zip(stops, plan.stops[1:], strict=True)]
    if max(moved, default=0) > limit_ns:
        return True
    return any(
        _platoon(a, before) != _platoon(b, now)
        for a, b in zip(segments, plan.segments, strict=True)
    )


def _members(plans: Iterable[VehiclePlan]) -> Members:
    found: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for plan in plans:
        for segment in plan.segments:
            if segment.platoon is not None and segment.place is not None:
                key = segment.platoon, segment.segment
                found.setdefault(key, []).append((segment.place, plan.vehicle))
    return {key: tuple(name for _, name in sorted(members)) for key, members in found.items()}


def _platoon(segment: PlannedSegment, members: Members) -> tuple[str, ...]:
    return () if segment.platoon is None else members[segment.platoon, segment.segment]

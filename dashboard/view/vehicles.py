"""Builds the vehicles' views from plans and reported positions; pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dashboard.live import Snapshot
from dashboard.view import labels
from dashboard.view.model import VehicleView
from slipstream import freshness
from slipstream.freshness import age_s
from slipstream.messages import CycleReport, PlannedStop, VehiclePlan, VehiclePosition

LIST_FOR_S: Final = 24 * 3600.0
"""Vehicles are listed this long after their plan expired, RSUs this long after their health, s."""


def vehicle_views(snapshot: Snapshot, now_ns: int) -> tuple[VehicleView, ...]:
    """The vehicles whose plan expired less than `LIST_FOR_S` ago, by name, idle ones last.

    Args:
        snapshot: the latest messages.
        now_ns: UTC in ns.
    """
    current = [
        plan
        for _, plan in sorted(snapshot.plans.items())
        if age_s(plan.valid_until_ns, now_ns) < LIST_FOR_S
    ]
    last = _last_good(snapshot.cycles, now_ns)
    views = []
    for index, plan in enumerate(current):
        position = snapshot.positions.get(plan.vehicle)
        if position is None or freshness.fault(position.time_ns, now_ns) is not None:
            position = None
        if position is None or position.cycle is None:
            views.append(_planned(plan, index, last, now_ns))
        else:
            followed = snapshot.followed.get(plan.vehicle)
            if followed is None or followed.cycle != position.cycle:
                followed = _without_route(plan)
            views.append(_driving(followed, position, index, now_ns))
    # Colours follow the names, so that none changes when a vehicle becomes idle.
    return tuple(sorted(views, key=lambda van: van.idle))


def _last_good(cycles: Sequence[CycleReport], now_ns: int) -> CycleReport | None:
    """The last successful cycle; a failed one leaves earlier plans valid."""
    for report in reversed(cycles):
        if report.status != "failed" and not freshness.is_ahead(report.started_ns, now_ns):
            return report
    return None


def _planned(plan: VehiclePlan, index: int, last: CycleReport | None, now_ns: int) -> VehicleView:
    """The view of a vehicle without a reported position on a plan: by its latest plan."""
    left_out = last is not None and plan.cycle != last.cycle and plan.issued_ns < last.started_ns
    idle = left_out or not (plan.segments or plan.stops)
    activity = _activity(plan, now_ns)
    if idle:
        activity = f"idle, no plan in cycle #{last.cycle}" if left_out and last else "idle"
        plan = _without_route(plan)
    return _view(
        plan,
        index,
        activity=activity,
        position=planned_position(plan, now_ns),
        idle=idle,
        expired=now_ns > plan.valid_until_ns,
    )


def _driving(plan: VehiclePlan, position: VehiclePosition, index: int, now_ns: int) -> VehicleView:
    """The view of a vehicle that reports its position on a plan, which may be an older one."""
    kmh = 3.6 * position.speed_mps
    leg = position.leg or 0
    stops = [stop.stop for stop in plan.stops]
    if position.on_road:
        to = "back" if leg + 2 >= len(stops) else f"to {stops[leg + 1]}"
        activity = f"{to}, {kmh:.0f} km/h" if stops else f"{kmh:.0f} km/h"
    elif leg > 0 and leg < len(stops):
        activity = _standing(plan.stops[leg], now_ns)
    else:
        wait_s = max(0.0, -age_s(plan.depart_ns, now_ns))
        activity = f"leaves {labels.relative_time(wait_s)}" if wait_s > 0 else "leaves now"
    return _view(
        plan,
        index,
        activity=activity,
        position=(position.segment, position.share),
        idle=False,
        expired=False,
    )


def _without_route(plan: VehiclePlan) -> VehiclePlan:
    nothing = {"stops": (), "segments": (), "distance_m": 0.0, "energy_kwh": 0.0}
    return plan.model_copy(update=nothing)


def _view(
    plan: VehiclePlan,
    index: int,
    *,
    activity: str,
    position: tuple[str, float] | None,
    idle: bool,
    expired: bool,
) -> VehicleView:
    return VehicleView(
        vehicle=plan.vehicle,
        rgb=labels.VEHICLE_RGB[index % len(labels.VEHICLE_RGB)],
        cycle=plan.cycle,
        expired=expired,
        idle=idle,
        route=tuple((part.segment, part.platoon) for part in plan.segments),
        stops=tuple((stop.stop, stop.node) for stop in plan.stops),
        position=position,
        activity=activity,
        distance_km=plan.distance_m / 1000,
        platoon_km=sum(
            part.speed_mps * (part.exit_ns - part.entry_ns) / 1e12
            for part in plan.segments
            if part.platoon is not None
        ),
        energy_kwh=plan.energy_kwh,
    )


def planned_position(plan: VehiclePlan, now_ns: int) -> tuple[str, float] | None:
    """Planned position: the segment, and the fraction of it driven, 0 to 1."""
    if not plan.segments:
        return None
    last = plan.segments[0].segment, 0.0
    for part in plan.segments:
        if now_ns < part.entry_ns:
            return last
        if now_ns < part.exit_ns:
            return part.segment, (now_ns - part.entry_ns) / (part.exit_ns - part.entry_ns)
        last = part.segment, 1.0
    return last


def _standing(stop: PlannedStop, now_ns: int) -> str:
    waits = stop.departure_ns - round(stop.wait_s * 1e9) <= now_ns < stop.departure_ns
    return f"waits at {stop.stop}" if waits else f"at {stop.stop}"


def _activity(plan: VehiclePlan, now_ns: int) -> str:
    if now_ns > plan.valid_until_ns:
        return f"plan ran out {labels.relative_time(-age_s(plan.valid_until_ns, now_ns))}"
    if now_ns < plan.depart_ns:
        return f"leaves {labels.relative_time(-age_s(plan.depart_ns, now_ns))}"
    for stop in plan.stops:
        if now_ns < stop.arrival_ns:
            return f"{stop.stop} {labels.relative_time(-age_s(stop.arrival_ns, now_ns))}"
        if now_ns < stop.departure_ns:
            return _standing(stop, now_ns)
    if plan.segments and now_ns < plan.segments[-1].exit_ns:
        return f"back {labels.relative_time(-age_s(plan.segments[-1].exit_ns, now_ns))}"
    return "done"

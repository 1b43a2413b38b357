"""Builds the vehicles' views from plans and reported positions; pure."""

from __future__ import annotations

from collections.abc import Collection, Container, Sequence
from dataclasses import replace
from typing import Final, Literal

from dashboard.live import Snapshot
from dashboard.view import labels, progress
from dashboard.view.model import LIST_FOR_S, VehicleView
from dashboard.view.progress import Progress
from slipstream import freshness
from slipstream.freshness import age_s
from slipstream.messages import (
    CycleReport,
    PlannedStop,
    SilentVehicle,
    VehiclePlan,
    VehiclePosition,
)

COLOURS: Final = 12
"""Of vehicles on the operator's page."""
_NAMED: Final = 5
SILENT_AFTER_S: Final = 15.0
"""Beyond this age of its last position the dispatcher plans nothing for a vehicle, s."""


def vehicle_views(
    snapshot: Snapshot,
    now_ns: int,
    open_roads: Container[str],
    fleet: Collection[str] = (),
    *,
    live: bool = True,
) -> tuple[VehicleView, ...]:
    """The fleet's vehicles, those whose plan expired or whose position came less than `LIST_FOR_S`
    ago, and those with open orders, by name, idle ones last.

    Args:
        snapshot: the latest messages.
        now_ns: UTC in ns.
        open_roads: roads on which platoons may drive close now; on others no plan's platoon is one.
        fleet: names of all vehicles.
        live: False of a past moment: positions are not stored, and plans that were no longer in
            force have been left out.
    """
    oldest_ns = now_ns - round(LIST_FOR_S * 1e9)
    plans = {name: plan for name, plan in snapshot.plans.items() if plan.valid_until_ns > oldest_ns}
    heard = {name for name, told in snapshot.positions.items() if told.time_ns > oldest_ns}
    missed = (
        {} if snapshot.dispatcher is None else {v.vehicle: v for v in snapshot.dispatcher.silent}
    )
    loaded = {order.vehicle for order in snapshot.orders if order.vehicle and not order.ended}
    loaded |= {name for name, told in missed.items() if told.orders}
    # A silent one with orders is listed for as long as it has them.
    heard |= loaded & (snapshot.positions.keys() | missed.keys())
    last = last_good(snapshot.cycles, now_ns) if live else None
    views = []
    for index, name in enumerate(sorted({*plans, *heard, *fleet})):
        plan = plans.get(name) or _no_plan(name)
        has_orders = name in loaded
        views.append(
            vehicle_view(
                snapshot,
                plan,
                index,
                last,
                now_ns,
                open_roads,
                live=live,
                has_orders=has_orders,
                missed=missed.get(name),
            )
        )
    # Colours follow the names, so that none changes when a vehicle becomes idle.
    return tuple(sorted(views, key=lambda van: van.idle))


def silent_lines(vans: Sequence[VehicleView]) -> list[str]:
    """What is said of vehicles that have work to do and are silent: nothing where none is."""
    silent = [van.vehicle for van in vans if van.silence in ("warn", "bad")]
    if not silent:
        return []
    names = ", ".join(silent[:_NAMED]) + (", …" if len(silent) > _NAMED else "")
    return [f"{labels.plural(len(silent), 'vehicle')} silent, with work to do: {names}"]


def _no_plan(vehicle: str) -> VehiclePlan:
    return VehiclePlan(
        vehicle=vehicle,
        cycle=0,
        issued_ns=0,
        valid_until_ns=0,
        depart_ns=0,
        stops=(),
        segments=(),
        distance_m=0.0,
        energy_kwh=0.0,
    )


def vehicle_view(
    snapshot: Snapshot,
    plan: VehiclePlan,
    index: int,
    last: CycleReport | None,
    now_ns: int,
    open_roads: Container[str],
    *,
    live: bool = True,
    has_orders: bool = False,
    missed: SilentVehicle | None = None,
) -> VehicleView:
    """The view of one vehicle.

    Args:
        snapshot: the latest messages.
        plan: its latest plan.
        index: of its colour.
        last: see `last_good`.
        now_ns: UTC.
        open_roads: see `vehicle_views`.
        live: likewise.
        has_orders: it has orders that have not ended.
        missed: what the dispatcher tells of it if it is silent: it may have heard it before the
            page was there.
    """
    position = snapshot.positions.get(plan.vehicle)
    if position is None and missed is not None:
        done = progress.missed(plan, missed)
        return _silent(plan, done, missed.heard_ns, index, now_ns, open_roads, has_orders)
    if position is None:
        return _planned(plan, None, index, last, now_ns, open_roads, live=live)
    followed = plan
    if position.cycle is not None and position.cycle != plan.cycle:
        known = snapshot.followed.get(plan.vehicle)
        same = known is not None and known.cycle == position.cycle
        followed = known if known is not None and same else _without_route(plan)
    if freshness.fault(position.time_ns, now_ns) is not None:
        done = progress.silent(followed, position)
        view = _silent(followed, done, position.time_ns, index, now_ns, open_roads, has_orders)
        return replace(view, charge_kwh=position.charge_kwh)
    if position.cycle is None:
        return _planned(plan, position, index, last, now_ns, open_roads)
    return _driving(followed, position, index, now_ns, open_roads)


def last_good(cycles: Sequence[CycleReport], now_ns: int) -> CycleReport | None:
    """The last successful cycle; a failed one leaves earlier plans valid."""
    for report in reversed(cycles):
        if report.status != "failed" and not freshness.is_ahead(report.started_ns, now_ns):
            return report
    return None


def _planned(
    plan: VehiclePlan,
    position: VehiclePosition | None,
    index: int,
    last: CycleReport | None,
    now_ns: int,
    open_roads: Container[str],
    *,
    live: bool = True,
) -> VehicleView:
    """The view of a vehicle that reports to follow no plan, or was never heard: by its latest."""
    left_out = last is not None and plan.cycle != last.cycle and plan.issued_ns < last.started_ns
    unheard = ", never heard" if live and position is None else ""
    if left_out or not (plan.segments or plan.stops):
        since_cycle = left_out and last is not None and plan.issued_ns > 0
        text = f"no plan in cycle #{last.cycle}" if since_cycle and last else ""
        activity = f"idle, {text}" if text else "idle"
        done = progress.idle((text or "has no plan") + unheard, position)
        plan = _without_route(plan)
    elif position is not None:
        done = progress.not_taken(plan, position, now_ns)
        activity = done.text
    else:
        done = progress.planned(plan, now_ns)
        activity = _activity(plan, now_ns)
        if done.state == "planned":
            activity = f"by plan: {activity}"
        done, activity = replace(done, text=done.text + unheard), activity + unheard
    return _view(
        plan,
        index,
        activity=activity,
        done=done,
        expired=now_ns > plan.valid_until_ns,
        open_roads=open_roads,
        charge_kwh=None if position is None else position.charge_kwh,
    )


def _silent(
    plan: VehiclePlan,
    done: Progress,
    heard_ns: int,
    index: int,
    now_ns: int,
    open_roads: Container[str],
    has_orders: bool,
) -> VehicleView:
    """The view of a vehicle that was heard, and is not now: where it was then."""
    silence: Literal["idle", "warn", "bad"] = "idle"
    if has_orders or (plan.stops and now_ns <= plan.valid_until_ns):
        overdue = abs(age_s(heard_ns, now_ns)) > SILENT_AFTER_S
        silence = "bad" if overdue else "warn"
    told = f"silent for {labels.duration(age_s(heard_ns, now_ns))}"
    if freshness.is_ahead(heard_ns, now_ns):
        told = "its clock is ahead of this one's"
        done = replace(done, text=f"{told}; {done.text}")
    return _view(
        plan,
        index,
        activity=f"{told}; {done.text}",
        done=done,
        expired=now_ns > plan.valid_until_ns,
        open_roads=open_roads,
        silent_ns=heard_ns,
        silence=silence,
    )


def _driving(
    plan: VehiclePlan,
    position: VehiclePosition,
    index: int,
    now_ns: int,
    open_roads: Container[str],
) -> VehicleView:
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
        done=progress.reported(plan, position, now_ns),
        expired=False,
        open_roads=open_roads,
        charge_kwh=position.charge_kwh,
    )


def _without_route(plan: VehiclePlan) -> VehiclePlan:
    nothing = {"stops": (), "segments": (), "distance_m": 0.0, "energy_kwh": 0.0}
    return plan.model_copy(update=nothing)


def _view(
    plan: VehiclePlan,
    index: int,
    *,
    activity: str,
    done: Progress,
    expired: bool,
    open_roads: Container[str],
    silent_ns: int | None = None,
    silence: Literal["idle", "warn", "bad"] | None = None,
    charge_kwh: float | None = None,
) -> VehicleView:
    return VehicleView(
        vehicle=plan.vehicle,
        rgb=labels.VEHICLE_RGB[index % len(labels.VEHICLE_RGB)],
        colour=index % COLOURS,
        plan=plan,
        open_roads=open_roads,
        progress=done,
        activity=activity,
        expired=expired,
        charge_kwh=charge_kwh,
        silent_ns=silent_ns,
        silence=silence,
    )


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

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
from slipstream.messages import CycleReport, SilentVehicle, VehiclePlan, VehiclePosition

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
        open_roads: roads on which platoons may drive close now; on others no plan's platoon is one.
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
        has_orders, gone = name in loaded, missed.get(name)
        views.append(
            vehicle_view(
                *(snapshot, plan, index, last, now_ns, open_roads),
                live=live,
                has_orders=has_orders,
                missed=gone,
            )
        )
    # Colours follow the names, so that none changes when a vehicle becomes idle.
    return tuple(sorted(views, key=lambda van: van.idle))


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
    """The view of one vehicle."""
    position = snapshot.positions.get(plan.vehicle)
    stale = position is not None and freshness.fault(position.time_ns, now_ns) is not None
    silent_ns = None
    if position is None and missed is not None:
        done, silent_ns = progress.missed(plan, missed), missed.heard_ns
    elif position is None or (position.cycle is None and not stale):
        plan, done = _of_latest(plan, position, last, now_ns, live)
    else:
        if position.cycle is not None and position.cycle != plan.cycle:
            followed = snapshot.followed.get(plan.vehicle)
            same = followed is not None and followed.cycle == position.cycle
            plan = followed if followed is not None and same else _without_route(plan)
        if stale:
            done, silent_ns = progress.silent(plan, position), position.time_ns
        else:
            done = progress.reported(plan, position, now_ns)
    silence: Literal["idle", "warn", "bad"] | None = None
    if silent_ns is not None:
        silence = "idle"
        if has_orders or (plan.stops and now_ns <= plan.valid_until_ns):
            silence = "bad" if abs(age_s(silent_ns, now_ns)) > SILENT_AFTER_S else "warn"
        if freshness.is_ahead(silent_ns, now_ns):
            done = replace(done, text=f"its clock is ahead of this one's; {done.text}")
    follows = position is not None and position.cycle is not None and not stale
    return VehicleView(
        colour=index % len(labels.VEHICLE_RGB),
        plan=plan,
        open_roads=open_roads,
        progress=done,
        expired=now_ns > plan.valid_until_ns and not follows,
        charge_kwh=None if position is None else position.charge_kwh,
        silent_ns=silent_ns,
        silence=silence,
    )


def last_good(cycles: Sequence[CycleReport], now_ns: int) -> CycleReport | None:
    """The last successful cycle; a failed one leaves earlier plans valid."""
    for report in reversed(cycles):
        if report.status != "failed" and not freshness.is_ahead(report.started_ns, now_ns):
            return report
    return None


def _of_latest(
    plan: VehiclePlan,
    position: VehiclePosition | None,
    last: CycleReport | None,
    now_ns: int,
    live: bool,
) -> tuple[VehiclePlan, Progress]:
    """Plan and progress of a vehicle that reports to follow no plan, or was never heard."""
    left_out = last is not None and plan.cycle != last.cycle and plan.issued_ns < last.started_ns
    unheard = ", never heard" if live and position is None else ""
    if left_out or not (plan.segments or plan.stops):
        since_cycle = left_out and last is not None and plan.issued_ns > 0
        text = f"no plan in cycle #{last.cycle}" if since_cycle and last else "has no plan"
        return _without_route(plan), progress.idle(text + unheard, position)
    if position is not None:
        return plan, progress.not_taken(plan, position, now_ns)
    done = progress.planned(plan, now_ns)
    return plan, replace(done, text=done.text + unheard)


def _without_route(plan: VehiclePlan) -> VehiclePlan:
    nothing = {"stops": (), "segments": (), "distance_m": 0.0, "energy_kwh": 0.0}
    return plan.model_copy(update=nothing)

"""Cards: all about one vehicle, road, roadside unit, order or cycle, now or at a past moment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Final, TypeVar

from fastapi import APIRouter, Query
from fastapi.responses import Response

from dashboard.web.routes import card_parts as parts
from dashboard.web.routes import count_parts, vehicle_parts
from dashboard.web.services import Page, PageServices, as_json
from dashboard.web.tables.rows import Known
from slipstream.http.problems import Problem
from storage import Reader

T = Annotated[int | None, Query(ge=0, lt=2**53, description="UTC of a past moment, ms.")]
_V = TypeVar("_V")

PLANS_TOLD: Final = 20
"""Latest plans of a vehicle on its card."""
HOUR_NS: Final = 3600 * 10**9

router = APIRouter(prefix="/api")


@router.get("/vehicles/{vehicle:path}")
def vehicle_card(page: Page, vehicle: str, t: T = None) -> Response:
    """All about a vehicle."""
    known = page.known(t)
    row = row_of(known, "vehicles", vehicle)
    plan = vehicle_parts.plan_of(known.snapshot, vehicle, row["cycle"])
    before = None if t is None or plan is None else plan.cycle + 1
    records = _stored(page, lambda reader: reader.plans_of(vehicle, PLANS_TOLD, before), ())
    reports = known.snapshot.cycles
    words = None if plan is None else page.words.of_cycle(plan.cycle, plan.issued_ns)
    told = None if words is None else words.of_vehicle(vehicle)
    return as_json(
        {
            "id": vehicle,
            **row,
            "plan": None
            if plan is None
            else vehicle_parts.plan_card(plan, row, page.scene, known.moment["orders"], records),
            "why_route": [] if plan is None else vehicle_parts.why_route(plan, reports, told),
            "why_platoon": []
            if plan is None
            else vehicle_parts.why_platoon(vehicle, plan, known, page.scene, told),
            "history": [vehicle_parts.plan_history(record) for record in records],
        }
    )


@router.get("/roads/{road:path}")
def road_card(page: Page, road: str, t: T = None) -> Response:
    """All about a road, watched or not."""
    known = page.known(t)
    segment = page.scene.places.network.segments.get(road)
    row = known.moment["roads"].get(road)
    if segment is None and row is None:
        raise Problem(404, f"no road {road[:200]} is here", "ask for one of the network's")
    begin_ns, end_ns = known.now_ns - HOUR_NS, known.now_ns + 1
    minutes = _stored(page, lambda reader: reader.rollups(road, begin_ns, end_ns), ())
    counted = (
        () if t is None else _stored(page, lambda reader: reader.counts(road, begin_ns, end_ns), ())
    )
    return as_json(
        {
            "id": road,
            **(row or {}),
            **parts.road_facts(segment),
            "p_stable": parts.stable_share(road, known) if known.moment["live"] else None,
            "features": parts.features(road, known)
            if known.moment["live"]
            else parts.features_of_minute(minutes, known.now_ns),
            "hour": parts.hour(minutes),
            "counts": count_parts.counts(road, known, counted),
            "refused": parts.refused(road, known),
            "stopped": parts.stopped(road, known),
        }
    )


@router.get("/rsus/{rsu:path}")
def rsu_card(page: Page, rsu: str, t: T = None) -> Response:
    """All about a roadside unit."""
    known = page.known(t)
    row = row_of(known, "rsus", rsu)
    return as_json({"id": rsu, **row, **parts.rsu_facts(rsu, known.snapshot)})


@router.get("/orders/{order:path}")
def order_card(page: Page, order: str, t: T = None) -> Response:
    """All about an order."""
    known = page.known(t)
    row = row_of(known, "orders", order)
    changes = _stored(page, lambda reader: reader.order_changes(order), ())
    record = next((one for one in known.snapshot.orders if one.order == order), None)
    return as_json(
        {
            "id": order,
            **row,
            "history": [
                parts.order_step(change) for change in changes if change.time_ns <= known.now_ns
            ],
            **parts.order_facts(record),
        }
    )


@router.get("/cycles/{number}")
def cycle_card(page: Page, number: int) -> Response:
    """All about a cycle, as long as it is kept."""
    known = page.known(None)
    report = next((one for one in known.snapshot.cycles if one.cycle == number), None)
    if report is None or report is not known.snapshot.cycles[-1]:
        # Of all but the last one only the figures are in memory.
        report = _stored(page, lambda reader: reader.cycle(number), None) or report
    if report is None:
        raise Problem(404, f"cycle {number} is not kept", "ask for one of the table's")
    words = page.words.of_cycle(number, report.started_ns)
    return as_json(parts.cycle_card(report, page.settings.factors, words))


def row_of(known: Known, table: str, name: str) -> dict[str, Any]:
    """A row of a table. Raises Problem 404 where it has none."""
    row: dict[str, Any] | None = known.moment[table].get(name)
    if row is None:
        raise Problem(404, f"{name[:200]} is not among the {table}", "ask for one that is")
    return row


def _stored(page: PageServices, read: Callable[[Reader], _V | Sequence[Any]], nothing: Any) -> Any:
    """What the database has; nothing without one."""
    return nothing if page.reader is None else read(page.reader)

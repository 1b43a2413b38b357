"""The kept past: its range, its moments, energy by hour and day, the report of a day, tables."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Mapping
from datetime import date
from typing import Annotated, Any, Final, Literal

from fastapi import APIRouter, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import HTMLResponse, Response, StreamingResponse
from pydantic import Field

from dashboard.web import report
from dashboard.web.energy import DAY_NS, local, zone_of
from dashboard.web.routes import export
from dashboard.web.routes.cards import T
from dashboard.web.services import Page, PageServices, as_json
from dashboard.web.tables.rows import TABLES
from slipstream.config import Settings, check, parse_json
from slipstream.errors import InputError
from slipstream.http.problems import Problem, from_input_error

HOURS_BACK_NS: Final = 7 * DAY_NS
"""Energy by hour goes so far back where no begin is asked for; by day it goes to the start."""
MAX_HOURS_NS: Final = 100 * DAY_NS

From = Annotated[int | None, Query(alias="from", ge=0, lt=2**53, description="UTC, ms.")]
Until = Annotated[int | None, Query(ge=0, lt=2**53, description="UTC, ms.")]
By = Annotated[Literal["hour", "day"], Query(description="Time of a sum.")]

router = APIRouter()


class ShownRows(Settings):
    """What a reader's browser shows of a table."""

    ids: Annotated[tuple[Annotated[str, Field(max_length=500)], ...], Field(max_length=20_000)] = (
        Field(description="Of its rows, in their order.")
    )


@router.get("/api/past")
def past(page: Page) -> Response:
    """The range of moments that are kept."""
    span = None if page.past is None else page.past.span()
    first, last = span or (None, None)
    # Up to the full millisecond within the range.
    return as_json(
        {
            "first": None if first is None else -(-first // 10**6),
            "last": None if last is None else last // 10**6,
        }
    )


@router.get("/api/at")
def at(page: Page, t: Annotated[int, Query(ge=0, lt=2**53, description="UTC, ms.")]) -> Response:
    """A moment of the past."""
    return as_json(page.known(t).moment)


@router.get("/api/energy")
def energy(page: Page, by: By = "hour", begin: From = None, until: Until = None) -> Response:
    """Energy by hour or day."""
    return as_json({"rows": _energy_rows(page, by, begin, until)})


@router.get("/report")
def day_report(
    page: Page, day: Annotated[date | None, Query(description="As 2026-11-23.")] = None
) -> HTMLResponse:
    """A day on one page, to be printed."""
    reader, stored = page.stored, page.stored_past
    settings, zone = page.settings, zone_of(page.settings.time_zone)
    now_ns = time.time_ns()
    if day is None:
        span = stored.span()
        # Of a finished run, its last one.
        told_ns = now_ns if page.hub is not None or span is None else span[1]
        day = local(told_ns, zone).date()
    if not 1970 < day.year < 2200:
        raise Problem(422, "no day that is kept", "give one as 2026-11-23", field="day")
    found = report.read_day(reader, day, zone, now_ns, stored.watched())
    html = report.report_html(
        found,
        title=settings.title,
        zone=zone,
        factors=settings.factors,
        currency=settings.currency,
        now_ns=now_ns,
    )
    return HTMLResponse(html)


@router.get("/api/export/{table}.csv")
def table_as_csv(
    page: Page, table: str, t: T = None, by: By = "hour", begin: From = None, until: Until = None
) -> StreamingResponse:
    """A table as shown now or at a moment, as CSV."""
    if table not in export.TABLES:
        known = ", ".join(export.TABLES)
        raise Problem(404, f"no table {table[:50]}", f"use one of: {known}")
    rows: Iterable[tuple[str, Mapping[str, Any]]]
    if table == "energy":
        rows = [("", row) for row in _energy_rows(page, by, begin, until)]
        stamp_ns = time.time_ns()
    else:
        found = page.known(t)
        rows, stamp_ns = export.sorted_rows(found.moment[table]), found.now_ns
    return _csv(page, table, rows, stamp_ns)


@router.post("/api/export/{table}.csv")
async def shown_table_as_csv(
    page: Page, table: str, request: Request, t: T = None
) -> StreamingResponse:
    """Rows of a table that a reader has filtered and sorted, in that order, as CSV."""
    if table not in TABLES:
        raise Problem(404, f"no rows of {table[:50]}", f"use one of: {', '.join(TABLES)}")
    try:
        ids = check(parse_json(await request.body(), "request"), ShownRows, "request").ids
    except InputError as error:
        raise from_input_error(error) from None
    found = await run_in_threadpool(page.known, t)
    known = found.moment[table]
    # One that has gone meanwhile is left out.
    rows = [(name, known[name]) for name in ids if name in known]
    return _csv(page, table, rows, found.now_ns)


def _csv(
    page: PageServices, table: str, rows: Iterable[tuple[str, Mapping[str, Any]]], stamp_ns: int
) -> StreamingResponse:
    stamp = local(stamp_ns, zone_of(page.settings.time_zone)).strftime("%Y%m%d-%H%M%S")
    title = re.sub(r"[^A-Za-z0-9]+", "-", page.settings.title).strip("-").lower() or "slipstream"
    name = f"{title}-{table}-{stamp}.csv"
    return StreamingResponse(
        export.csv_parts(table, rows),
        media_type="text/csv; charset=utf-8",
        headers={"Content-Disposition": f'attachment; filename="{name}"'},
    )


def _energy_rows(
    page: PageServices, by: Literal["hour", "day"], begin: int | None, until: int | None
) -> list[dict[str, Any]]:
    stored = page.stored_past
    end_ns = (stored.span() or (0, time.time_ns()))[1] + 1 if until is None else until * 10**6
    if begin is not None:
        begin_ns = begin * 10**6
    else:
        begin_ns = max(0, end_ns - HOURS_BACK_NS) if by == "hour" else 0
    if by == "hour" and end_ns - begin_ns > MAX_HOURS_NS:
        raise Problem(422, "more than 100 days by hour", "ask for them by day", field="by")
    return stored.energy.rows(begin_ns, end_ns, by)

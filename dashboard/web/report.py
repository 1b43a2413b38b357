"""The report of a day: what was driven, saved and served, on one printed page; pure but for the
reading of the database.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Any, Final, NamedTuple

from dashboard.html import templates
from dashboard.settings import Factors
from dashboard.web.energy import Zone, by_day, local, midnight_ns, total
from dashboard.web.tables.rows import sum_row
from slipstream.energy.ledger import HOUR_NS, EnergySum
from storage import CycleSums, Event, OrderEnd, Reader

MAX_ALARMS: Final = 12
MAX_RSUS: Final = 12
"""Lines of the report's tables; more are counted, so that it stays on one page."""
_MINUTE_NS: Final = 60 * 10**9
_EVENTS: Final = 1000
_CHART_HEIGHT: Final = 120.0


class UpTime(NamedTuple):
    """Share of a day's seconds in which an RSU reported on its roads, and measured them."""

    rsu: str
    reported: float
    measured: float


@dataclass(frozen=True)
class Day:
    """What is stored of a day.

    Attributes:
        until_ns: UTC up to which it is told of, its end or now.
        baseline: name of the plan that it is held against; None: nothing was driven.
        more_alarms: whether there were more than are told of.
    """

    day: date
    begin_ns: int
    end_ns: int
    until_ns: int
    hours: Sequence[EnergySum]
    baseline: str | None
    span: tuple[int, int] | None
    ends: Sequence[OrderEnd]
    cycles: CycleSums
    alarms: Sequence[Event]
    more_alarms: bool
    rsus: Sequence[UpTime]


def read_day(
    reader: Reader, day: date, zone: Zone, now_ns: int, watched: Mapping[str, Sequence[str]]
) -> Day:
    """Read a day from the database.

    Raises:
        StorageError: the database cannot be read.
    """
    begin_ns = midnight_ns(datetime(day.year, day.month, day.day), zone)
    following = day + timedelta(days=1)
    end_ns = midnight_ns(datetime(following.year, following.month, following.day), zone)
    span = reader.span()
    first_ns = begin_ns if span is None else max(begin_ns, span[0])
    until_ns = min(end_ns, max(now_ns, begin_ns))
    last = reader.last_energy(end_ns - 1)
    events = reader.events(begin_ns, end_ns, limit=_EVENTS)
    alarms = [event for event in events if event.alarm is not None]
    rank = {"critical": 0, "warning": 1, "info": 2}
    counted = reader.state_counts(first_ns - first_ns % HOUR_NS, end_ns)
    return Day(
        day=day,
        begin_ns=begin_ns,
        end_ns=end_ns,
        until_ns=until_ns,
        hours=reader.energy_sums(begin_ns, end_ns, by="hour"),
        baseline=None if last is None or last.energy is None else last.energy.baseline,
        span=span,
        ends=reader.order_ends(begin_ns, end_ns),
        cycles=reader.cycle_sums(begin_ns, end_ns),
        alarms=sorted(alarms, key=lambda event: (rank.get(event.severity, 3), event.time_ns)),
        more_alarms=len(events) == _EVENTS,
        rsus=availability(watched, counted, (until_ns - first_ns) / 1e9),
    )


def availability(
    watched: Mapping[str, Sequence[str]], counted: Mapping[str, tuple[int, int]], time_s: float
) -> list[UpTime]:
    """Shares of RSUs, the worst first.

    A segment state comes once a second. What several RSUs report of one road cannot be told apart:
    each counts with its part.

    Args:
        counted: states that came of each road, and those with features.
    """
    watchers = Counter(road for roads in watched.values() for road in roads)
    found = []
    for rsu, roads in watched.items():
        wanted = time_s * len(roads)
        if wanted <= 0:
            continue
        shares = [
            min(
                1.0,
                sum(counted.get(road, (0, 0))[place] / watchers[road] for road in roads) / wanted,
            )
            for place in (0, 1)
        ]
        found.append(UpTime(rsu, *shares))
    return sorted(found, key=lambda one: (one.reported, one.measured, one.rsu))


class Bar(NamedTuple):
    """An hour in the chart: places in its units, from the left and from the top."""

    hour: str
    x: float
    width: float
    baseline_y: float
    baseline_height: float
    plan_y: float
    plan_height: float
    is_worse: bool


class Tick(NamedTuple):
    """A line of the chart's scale."""

    y: float
    label: str


def chart(day: Day, zone: Zone, width: float = 720.0) -> tuple[list[Bar], list[Tick]]:
    """Bars of the day's hours, the baseline's energy behind the plans', and the scale."""
    hours = {hour.begin_ns: hour for hour in day.hours}
    begins = range(day.begin_ns, day.end_ns, HOUR_NS)
    highest = max((max(h.baseline_kwh, h.plan_kwh) for h in day.hours), default=0.0)
    step = _nice(highest / 4)
    top = step * max(1, -(-highest // step))
    bars = []
    for number, begin_ns in enumerate(begins):
        # A zone may be off by half an hour.
        found = [hour for at, hour in hours.items() if begin_ns <= at < begin_ns + HOUR_NS]
        driven = total(found, begin_ns)
        baseline, plan = (
            round(_CHART_HEIGHT * kwh / top, 2) for kwh in (driven.baseline_kwh, driven.plan_kwh)
        )
        bars.append(
            Bar(
                hour=f"{local(begin_ns, zone):%H}",
                x=round(width * number / len(begins), 2),
                width=round(width / len(begins) - 4, 2),
                baseline_y=round(_CHART_HEIGHT - baseline, 2),
                baseline_height=baseline,
                plan_y=round(_CHART_HEIGHT - plan, 2),
                plan_height=plan,
                is_worse=driven.plan_kwh > driven.baseline_kwh,
            )
        )
    count = round(top / step)
    ticks = [
        Tick(round(_CHART_HEIGHT * (1 - n / count), 2), f"{n * step:g}") for n in range(count + 1)
    ]
    return bars, ticks


def _nice(step: float) -> float:
    """The next 1, 2 or 5 times a power of ten; 1 of nothing."""
    if step <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(step))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= step * 0.999)


def report_html(
    day: Day, *, title: str, zone: Zone, factors: Factors, currency: str, now_ns: int
) -> str:
    """The page."""
    bars, ticks = chart(day, zone)
    states = Counter(end.state for end in day.ends)
    late = sum(
        end.state == "served" and end.latest_ns is not None and end.time_ns > end.latest_ns
        for end in day.ends
    )
    whole = by_day(day.hours, zone)
    energy: dict[str, Any] | None = None
    if whole:
        energy = sum_row(total(whole, day.begin_ns), factors, day.baseline)
    known = [one.reported for one in day.rsus]
    return _TEMPLATES.get_template("report.html.j2").render(
        title=title,
        day=day,
        energy=energy,
        co2_kg_per_kwh=factors.co2_kg_per_kwh,
        price_per_kwh=factors.price_per_kwh,
        currency=currency,
        bars=bars,
        ticks=ticks,
        chart_height=_CHART_HEIGHT,
        orders={"served": states["served"], "failed": states["failed"]}
        | {"cancelled": states["cancelled"], "late": late},
        severities=Counter(alarm.severity for alarm in day.alarms),
        alarms=day.alarms[:MAX_ALARMS],
        rsus=day.rsus[:MAX_RSUS],
        mean_reported=sum(known) / len(known) if known else None,
        is_over=day.until_ns == day.end_ns,
        until=clock(day.until_ns, zone),
        unkept=_unkept(day, zone),
        printed=f"{local(_minute(now_ns), zone):%Y-%m-%d %H:%M %Z}",
        zone_name=f"{local(day.begin_ns, zone):%Z}",
        clock=lambda time_ns: clock(time_ns, zone),
    )


def clock(time_ns: int, zone: Zone) -> str:
    """A clock time, to the nearest minute: a hair short of one is not a minute less."""
    return f"{local(_minute(time_ns), zone):%H:%M}"


def _minute(time_ns: int) -> int:
    return round(time_ns / _MINUTE_NS) * _MINUTE_NS


def _unkept(day: Day, zone: Zone) -> str | None:
    """What of the day is not kept, in words; None: all of it is."""
    if day.span is None:
        return "Nothing is stored yet."
    first, last = day.span
    kept = " to ".join(f"{local(_minute(ns), zone):%Y-%m-%d %H:%M %Z}" for ns in day.span)
    if last < day.begin_ns or first >= day.end_ns:
        return f"Nothing is kept of this day: the past is kept from {kept}."
    return f"The past is kept from {kept}." if first > day.begin_ns else None


def _number(value: float | None, digits: int = 0) -> str:
    return "–" if value is None else f"{value:,.{digits}f}".replace(",", "\u202f")


def _percent(share: float | None, digits: int = 1) -> str:
    return "–" if share is None else f"{100 * share:.{digits}f}\u202f%"


_TEMPLATES: Final = templates(Path(__file__).parent / "templates", number=_number, percent=_percent)

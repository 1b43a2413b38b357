"""What was driven and saved, out of the energy ledger: by hour and day, this day, this week, since
the start, in the page's time zone.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import fields, replace
from datetime import datetime, timedelta
from math import fsum
from typing import Any, Final, Literal
from zoneinfo import ZoneInfo

from dashboard.settings import Factors
from dashboard.web.tables.rows import cycle_energy, sum_row
from slipstream.energy.ledger import HOUR_NS, EnergySum
from storage import Reader

Zone = ZoneInfo | None
"""None: the machine's."""
DAY_NS: Final = 24 * HOUR_NS
_EVER_NS: Final = 2**62
_FIGURES: Final = tuple(field.name for field in fields(EnergySum))[1:]


def zone_of(name: str | None) -> Zone:
    """The zone of a name; None: the machine's."""
    return None if name is None else ZoneInfo(name)


def total(parts: Iterable[EnergySum], begin_ns: int) -> EnergySum:
    """The sum of several times."""
    found = list(parts)
    figures = {name: fsum(getattr(part, name) for part in found) for name in _FIGURES}
    return EnergySum(begin_ns, **figures)


def local(time_ns: int, zone: Zone) -> datetime:
    """A moment in a zone."""
    return datetime.fromtimestamp(time_ns / 1e9, zone).astimezone(zone)


def midnight_ns(day: datetime, zone: Zone) -> int:
    """UTC of the begin of a moment's day in a zone; days may have 23 or 25 hours."""
    begin = datetime(day.year, day.month, day.day, tzinfo=zone)
    return round(begin.timestamp()) * 10**9


def day_begins(time_ns: int, zone: Zone) -> int:
    """UTC of the begin of the day that a moment lies in."""
    return midnight_ns(local(time_ns, zone), zone)


def week_begins(time_ns: int, zone: Zone) -> int:
    """UTC of the begin of the week, Monday, that a moment lies in."""
    day = local(time_ns, zone)
    return midnight_ns(day.replace(hour=12) - timedelta(days=day.weekday()), zone)


def by_day(hours: Iterable[EnergySum], zone: Zone) -> list[EnergySum]:
    """Sums of days from those of hours, oldest first. An hour counts to the day it begins in."""
    groups: dict[int, list[EnergySum]] = {}
    for hour in hours:
        groups.setdefault(day_begins(hour.begin_ns, zone), []).append(hour)
    return [total(group, begin_ns) for begin_ns, group in sorted(groups.items())]


class EnergyBook:
    """Reads the ledger; from any thread. Days that are long over are read once."""

    def __init__(self, reader: Reader, zone: Zone, factors: Factors) -> None:
        self._reader = reader
        self._zone = zone
        self._factors = factors
        self._lock = threading.Lock()
        self._upto_ns = 0
        self._days: tuple[EnergySum, ...] = ()
        self._since_ns: int | None = None
        self.latest: dict[str, Any] | None = None
        """What `refresh` has read; None: it has not."""

    def refresh(self, now_ns: int) -> None:
        """Read the sums until now for `latest`.

        Raises:
            StorageError: the database cannot be read.
        """
        self.latest = self.at(now_ns)

    def at(self, time_ns: int) -> dict[str, Any]:
        """Sums until a moment: of its day, its week, and since the start, with those of the last
        cycle that drove. Of the hour that it lies in a part counts, see `_hours`.

        Raises:
            StorageError: the database cannot be read.
        """
        end_ns = time_ns + 1
        week_ns, day_ns = week_begins(time_ns, self._zone), day_begins(time_ns, self._zone)
        last = self._reader.last_energy(time_ns)
        baseline = None if last is None or last.energy is None else last.energy.baseline
        hours = self._hours(week_ns, end_ns)
        found: dict[str, Any] = {
            "today": None,
            "week": None,
            "total": None,
            "since": None,
            "last_cycle": None
            if last is None or last.energy is None
            else cycle_energy(last.energy, self._factors),
        }
        whole, since_ns = self._whole(time_ns)
        if since_ns is None:
            return found
        today = [hour for hour in hours if hour.begin_ns >= day_ns]

        def row(driven: EnergySum) -> dict[str, Any]:
            return sum_row(driven, self._factors, baseline)

        return found | {
            "today": row(total(today, day_ns)),
            "week": row(total(hours, week_ns)),
            "total": row(whole),
            "since": since_ns // 10**6,
        }

    def rows(self, begin_ns: int, end_ns: int, by: Literal["hour", "day"]) -> list[dict[str, Any]]:
        """Sums of the hours or days of a range of time, with their begin as `t`, ms of UTC; those
        in which nothing was driven are missing. Of the hour that it ends in a part counts.

        Raises:
            StorageError: the database cannot be read.
        """
        hours = self._hours(begin_ns, end_ns)
        parts = by_day(hours, self._zone) if by == "day" else hours
        last = self._reader.last_energy(_EVER_NS)
        baseline = None if last is None or last.energy is None else last.energy.baseline
        return [
            {"t": part.begin_ns // 10**6, **sum_row(part, self._factors, baseline)}
            for part in parts
        ]

    def _hours(self, begin_ns: int, end_ns: int) -> list[EnergySum]:
        """Sums by hour until a moment.

        The ledger has whole hours: the one that a past moment lies in counts by the share of its
        time that had passed, so that nothing counts that came long after. Of the present all
        counts that is booked.
        """
        hours = list(self._reader.energy_sums(begin_ns, end_ns, by="hour"))
        span = self._reader.span() if hours and hours[-1].begin_ns + HOUR_NS > end_ns else None
        if span is not None:
            begun_ns = max(hours[-1].begin_ns, span[0] if span[0] < end_ns else 0)
            over_ns = min(hours[-1].begin_ns + HOUR_NS, span[1])
            if end_ns < over_ns:
                share = max(0, end_ns - begun_ns) / (over_ns - begun_ns)
                figures = {name: share * getattr(hours[-1], name) for name in _FIGURES}
                hours[-1] = EnergySum(hours[-1].begin_ns, **figures)
        return hours

    def _whole(self, time_ns: int) -> tuple[EnergySum, int | None]:
        """The sum since the start, and UTC of its first hour; None: nothing was driven yet."""
        end_ns = time_ns + 1
        # What is booked late belongs to the last hours.
        over_ns = time_ns // DAY_NS * DAY_NS - DAY_NS
        with self._lock:
            if over_ns > self._upto_ns:
                self._days = self._reader.energy_sums(0, over_ns, by="day")
                self._since_ns, self._upto_ns = None, over_ns
            begin_ns = min(over_ns, self._upto_ns)
            days = [day for day in self._days if day.begin_ns < begin_ns]
            if days and self._since_ns is None:
                first_ns = days[0].begin_ns
                self._since_ns = self._reader.energy_sums(first_ns, first_ns + DAY_NS, by="hour")[
                    0
                ].begin_ns
            since_ns = self._since_ns if days else None
        rest = self._hours(begin_ns, end_ns)
        if since_ns is None and rest:
            since_ns = rest[0].begin_ns
        whole = total([*days, *rest], since_ns or 0)
        return replace(whole, begin_ns=since_ns or 0), since_ns

"""Clock times of a fleet's file, and the seconds that they are in one cycle. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import date, datetime, time, timedelta, tzinfo
from pathlib import Path
from typing import Annotated, Final
from zoneinfo import ZoneInfo

from pydantic import AfterValidator

from slipstream.errors import InputError

_DAY: Final = timedelta(days=1)


def _is_clock(text: str) -> str:
    parse(text)
    return text


def _is_zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise ValueError("no time zone that this machine knows, such as Europe/Berlin") from None
    return name


Clock = Annotated[str, AfterValidator(_is_clock)]
"""A time of day, "08:30" or "08:30:15", of each day; or with a date, "2026-11-23T08:30:00+01:00".
Without a zone it is in the fleet's."""
ZoneName = Annotated[str, AfterValidator(_is_zone)]


def parse(text: str) -> time | datetime:
    """Read a `Clock`.

    Raises:
        ValueError: it is none.
    """
    try:
        at = time.fromisoformat(text) if len(text) < len("2026-11-23") else None
        at_date = datetime.fromisoformat(text) if at is None else None
    except ValueError:
        at = at_date = None
    if at_date is not None and "T" in text.upper().replace(" ", "T"):
        return at_date
    if at is not None and at.tzinfo is None and ":" in text:
        return at
    raise ValueError('no clock time, write "08:30" or "2026-11-23T08:30:00+01:00"')


def seconds_after(
    clocks: Mapping[str, str | None], zone: tzinfo, reference_ns: int
) -> dict[str, float]:
    """Clock times of one stop or vehicle as seconds after a moment, negative before it.

    Times of day are those of the day that the moment is in. Where the last of them is before the
    first one they go over midnight; until the last has passed they are those that began the day
    before.

    Args:
        clocks: by key, in the order in which they follow each other; None: not given.
        zone: of times without one.
        reference_ns: the moment, UTC.
    """
    now = datetime.fromtimestamp(reference_ns // 10**9, zone)
    read = {key: parse(text) for key, text in clocks.items() if text is not None}
    daily = [at for at in read.values() if isinstance(at, time)]
    begins = now.date()
    if daily and daily[-1] < daily[0] and now <= _at(begins, daily[-1], zone):
        begins -= _DAY
    found = {}
    for key, at in read.items():
        if isinstance(at, time):
            at = _at(begins + _DAY if at < daily[0] else begins, at, zone)
        elif at.tzinfo is None:
            at = at.replace(tzinfo=zone)
        found[key] = (utc_ns(at) - reference_ns) / 1e9
    return found


def _at(day: date, at: time, zone: tzinfo) -> datetime:
    return datetime.combine(day, at, zone)


def utc_ns(at: datetime) -> int:
    """A moment in UTC nanoseconds, exact to the microsecond that it is given in."""
    return round(at.timestamp() * 1e6) * 1000


def given_twice(
    clocks: Mapping[str, str | None], given: set[str], source: str | Path, key: str
) -> Iterator[InputError]:
    """Times that a row has as clock time and in seconds."""
    for name, text in clocks.items():
        if text is not None and f"{name}_s" in given:
            problem = f"{name}_s is given too"
            yield InputError(source, problem, "give one of both", key=f"{key}.{name}")

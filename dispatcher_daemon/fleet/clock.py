"""Clock times of a fleet's file, and the seconds that they are in one cycle. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import date, datetime, time, timedelta, tzinfo
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Final
from zoneinfo import ZoneInfo

from pydantic import AfterValidator

from slipstream.errors import InputError
from slipstream.iso_time import read_datetime

_DAY: Final = timedelta(days=1)
_NIGHT_ENDS: Final = timedelta(hours=4)
"""A time of day before this one is of the night between two days."""
_LONG_PAST: Final = timedelta(hours=12)
_BEGINS: Final = ("earliest", "ready")
_ANY_DAY: Final = "2000-01-01"


def _is_clock(text: str) -> str:
    parse_clock(text)
    return text


def _is_zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise ValueError("no time zone that this machine knows, such as Europe/Berlin") from None
    return name


Clock = Annotated[str, AfterValidator(_is_clock)]
"""A time of day, "08:30", "08:30:15" or "24:00", of each day; or with a date,
"2026-11-23T08:30:00+01:00". Without a zone it is in the fleet's."""
ZoneName = Annotated[str, AfterValidator(_is_zone)]


def parse_clock(text: str) -> timedelta | datetime:
    """Read a `Clock`: the wall clock's time since midnight, at most a day; or a moment.

    Raises:
        ValueError: it is none.
    """
    try:
        if len(text) >= len("2026-11-23"):
            if "T" in text.upper().replace(" ", "T"):
                return read_datetime(text)
        elif ":" in text:
            # As of any day: "24:00" is read with dates.
            at = read_datetime(f"{_ANY_DAY}T{text}")
            if at.tzinfo is None:
                return at - datetime.fromisoformat(_ANY_DAY)
    except ValueError:
        pass
    raise ValueError('no clock time, write "08:30" or "2026-11-23T08:30:00+01:00"')


def seconds_after(
    clocks: Mapping[str, str | None], zone: tzinfo, reference_ns: int
) -> dict[str, float]:
    """Clock times of one stop or vehicle as seconds after a moment, negative before it.

    See `moments` for the days that times of day are of.

    Args:
        clocks: by key, in the order in which they follow each other; None: not given.
    """
    found = clock_moments(clocks, zone, reference_ns)
    return {key: (utc_ns(at) - reference_ns) / 1e9 for key, at in found.items()}


def clock_moments(
    clocks: Mapping[str, str | None],
    zone: tzinfo,
    reference_ns: int,
    shift: datetime | None = None,
) -> dict[str, datetime]:
    """The moments that clock times are.

    Times of day are those of the day that the moment is in. Where the last of them is before the
    first one they go over midnight; until the last has passed they are those that began the day
    before. All are of the next day

    - where the last is an end and has passed half a day ago, or is before 04:00 and it is 04:00;
    - where a begin stands alone, is before 04:00, and has passed half a day ago.

    An hour that clocks have twice is the first one, one that they skip is that much later.

    Args:
        clocks: as of `seconds_after`; of several breaks, each key after its break's number.
        shift: when the shift over midnight begins that breaks are in; None: there is none.
    """
    now = datetime.fromtimestamp(reference_ns // 10**9, zone)
    read = {key: parse_clock(text) for key, text in clocks.items() if text is not None}
    daily = {key: at for key, at in read.items() if isinstance(at, timedelta)}
    day, first = now.date(), timedelta()
    if daily:
        first, last = next(iter(daily.values())), next(reversed(daily.values()))
        is_end = not next(reversed(daily)).endswith(_BEGINS)
        if first == _DAY and next(iter(daily)).endswith(_BEGINS):
            first = daily[next(iter(daily))] = timedelta()
        if shift is not None:
            day = shift.date()
            if _at(day + _DAY if last < first else day, last, zone) < shift:
                day += _DAY
        elif last < first:
            day -= _DAY if now <= _at(day, last, zone) else timedelta()
        elif _is_over(now - _at(day, last, zone), now, last, is_end=is_end):
            day += _DAY
    found = {}
    for key, at in read.items():
        if isinstance(at, timedelta):
            at = daily[key]
            found[key] = _at(day + _DAY if at < first else day, at, zone)
        else:
            found[key] = at.replace(tzinfo=zone) if at.tzinfo is None else at
    return found


def _is_over(past: timedelta, now: datetime, last: timedelta, *, is_end: bool) -> bool:
    """Whether times of day whose last one was so long ago are rather the next day's."""
    of_night = last < _NIGHT_ENDS
    if is_end and of_night and past > timedelta():
        return past >= _LONG_PAST or now.hour >= _NIGHT_ENDS // timedelta(hours=1)
    return past >= _LONG_PAST and (is_end or of_night)


def over_midnight(clocks: Mapping[str, str | None]) -> bool:
    """Whether times of day begin on one day and end on the next."""
    read = [parse_clock(text) for text in clocks.values() if text is not None]
    daily = [at for at in read if isinstance(at, timedelta)]
    return bool(daily) and daily[-1] < daily[0]


def check_order(clocks: Mapping[str, str | None]) -> None:
    """Times of day that follow each other do so within a day.

    Raises:
        ValueError: one is after the one that it should be before.
    """
    daily = {
        k: at
        for k, text in clocks.items()
        if text and isinstance(at := parse_clock(text), timedelta)
    }
    first = next(iter(daily.values()), timedelta())
    after = [
        (key, (at - first) % _DAY if at != first + _DAY else _DAY) for key, at in daily.items()
    ]
    for (one, a), (other, b) in pairwise(after):
        if b < a:
            raise ValueError(
                f"{other} ({clocks[other]}) is before {one} ({clocks[one]}), counted from "
                f"{after[0][0]} ({clocks[after[0][0]]})"
            )


def _at(day: date, at: timedelta, zone: tzinfo) -> datetime:
    return datetime.combine(day, time(), zone) + at


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

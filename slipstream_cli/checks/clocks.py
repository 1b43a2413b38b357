"""What a fleet file's times of day are taken for, now."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Final
from zoneinfo import ZoneInfo

if TYPE_CHECKING:
    from dispatcher_daemon.fleet import Fleet, Stop, Vehicle

_MAX_NOTES: Final = 50
_MAX_NAMES: Final = 5


def clock_notes(path: Path, fleet: Fleet, reference_ns: int) -> tuple[str, ...]:
    """One line for each time of day that rows of the file share, with its date.

    Args:
        reference_ns: the moment that it is read at, UTC.
    """
    now = datetime.fromtimestamp(reference_ns // 10**9, UTC)
    rows: dict[tuple[str, str, datetime], list[str]] = {}
    for name, key, text, at in _times(fleet, reference_ns):
        rows.setdefault((key, text, at), []).append(name)
    lines = []
    for (key, text, at), names in islice(rows.items(), _MAX_NOTES):
        some = ", ".join(names[:_MAX_NAMES]) + (", …" if len(names) > _MAX_NAMES else "")
        passed = ", which has passed" if at < now else ""
        lines.append(
            f'{path}: {key} "{text}" is {at.isoformat(timespec="minutes")}{passed}: {some}'
        )
    return tuple(lines)


def _times(fleet: Fleet, reference_ns: int) -> Iterator[tuple[str, str, str, datetime]]:
    """(row, key, text, moment) of each time of day."""
    from dispatcher_daemon.fleet import clock_moments, parse_clock

    zone = ZoneInfo(fleet.time_zone)
    rows: tuple[Stop | Vehicle, ...] = (*fleet.stops, *fleet.vehicles)
    found = [
        (row.id, key, row.clocks[key], at)
        for row in rows
        for key, at in clock_moments(row.clocks, zone, reference_ns).items()
    ]
    for vehicle in fleet.vehicles:
        for (number, key), at in vehicle.break_moments(zone, reference_ns).items():
            text = vehicle.breaks[number].clocks[key]
            found.append((vehicle.break_id(number), key, text, at))
    for name, key, text, at in found:
        if text is not None and not isinstance(parse_clock(text), datetime):
            yield name, key, text, at

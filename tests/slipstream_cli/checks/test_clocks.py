"""What `slipstream check` says of a fleet file's times of day."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from dispatcher_daemon.fleet import Fleet
from slipstream_cli.checks.clocks import clock_notes


def test_each_time_of_day_is_told_with_its_date() -> None:
    """Once for all rows that share it; one that has passed says so; dates speak for themselves."""
    night = {"duration_s": 60, "earliest": "00:30", "latest": "01:00"}
    rows = {
        "time_zone": "Europe/Berlin",
        "depots": [{"id": "d", "node": "n"}],
        "stops": [
            {"id": "a", "node": "n", "latest": "09:00"},
            {"id": "b", "node": "n", "latest": "2026-11-23T20:00"},
        ],
        "vehicles": [
            {"id": "v", "return_by": "00:30"},
            {"id": "w", "return_by": "00:30", "breaks": [night]},
        ],
    }
    at = datetime.fromisoformat("2026-11-23T18:00+01:00")
    said = clock_notes(Path("f"), Fleet.model_validate(rows), round(at.timestamp()) * 10**9)
    assert said == (
        'f: latest "09:00" is 2026-11-23T09:00+01:00, which has passed: a',
        'f: return_by "00:30" is 2026-11-24T00:30+01:00: v, w',
        'f: earliest "00:30" is 2026-11-24T00:30+01:00: w break 1',
        'f: latest "01:00" is 2026-11-24T01:00+01:00: w break 1',
    )

"""Refusals of an order's fields, in the words of who sends orders."""

from __future__ import annotations

from typing import Any

import pytest

from dispatcher_daemon.service.intake import read_request
from slipstream.orders import OrderRefused


@pytest.mark.parametrize(
    ("change", "problem", "mend"),
    [
        ({"demand": -5}, "demand: -5 is below 0", "give 0 or more"),
        ({"demand": 1.5}, "demand: 1.5 is no whole number", "give a whole number"),
        ({"mass_kg": "heavy"}, "mass_kg: 'heavy' is no number", "give a number"),
        ({"service_s": 1e5}, "service_s: 100000.0 is above 86400", "give 86400 or less"),
        ({"id": ""}, "id: '' is empty", "give a text"),
        ({"carrier": 7}, "carrier: 7 is no text", "give a text in quotes"),
        ({"skills": "cold"}, "skills: 'cold' is no list", "give a list"),
        ({"node": None}, "it has no place", "give a junction as node, or lat and lon"),
        ({"lat": 3.0}, "one of lat and lon is missing", "give both, or neither"),
        (
            {"earliest": "08:30"},
            "earliest: no time with its date and zone (got '08:30')",
            "write it like 2026-11-23T08:00:00Z or 2026-11-23T09:00:00+01:00",
        ),
        (
            {"earliest": "2026-11-23T09:00:00Z", "latest": "2026-11-23T08:00:00Z"},
            "latest: its window ends before it begins (got '2026-11-23T08:00:00Z')",
            "give a latest after earliest",
        ),
    ],
)
def test_a_field_that_is_wrong_is_told_in_plain_words(
    change: dict[str, Any], problem: str, mend: str
) -> None:
    """What it is, why it cannot be, and what may stand there instead."""
    with pytest.raises(OrderRefused) as refused:
        read_request({"id": "o", "node": "c1", **change})
    assert (refused.value.refusal.problem, refused.value.refusal.mend) == (problem, mend)


def test_the_end_of_a_day_is_a_time() -> None:
    """24:00 of one day is 00:00 of the next."""
    ends = [
        read_request({"id": "o", "node": "c1", "latest": text}).latest
        for text in ("2026-11-23T24:00:00Z", "2026-11-24T00:00:00Z")
    ]
    assert ends[0] == ends[1]

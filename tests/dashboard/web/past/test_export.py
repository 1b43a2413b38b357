"""Tables as CSV."""

from __future__ import annotations

import csv
import io

import pytest

from dashboard.web.routes.export import TABLES, csv_parts, sorted_rows


def read(table: str, rows: dict[str, dict[str, object]]) -> list[dict[str, str]]:
    """The rows of a table as a spreadsheet reads them."""
    text = b"".join(csv_parts(table, sorted_rows(rows))).decode()
    return list(csv.DictReader(io.StringIO(text)))


def test_a_row_is_told_in_words_and_units() -> None:
    """Times as ISO 8601, lists joined, nothing for what is not known; other fields are left out."""
    row = {
        "level": "ok",
        "state": "driving",
        "text": "drives to s1",
        "with": ["van-2", "van-3"],
        "eta": 1_790_000_000_500,
        "delay_s": None,
        "x": 12.5,
        "route": [[1, 0]],
    }
    (found,) = read("vehicles", {"van-1": row})
    assert found["vehicle"] == "van-1"
    assert found["doing"] == "drives to s1"
    assert found["with"] == "van-2; van-3"
    assert found["eta"] == "2026-09-21T14:13:20+00:00"
    assert (found["delay_s"], found["x_m"]) == ("", "12.5")
    assert "route" not in found


def test_rows_come_by_name_and_cycles_by_number() -> None:
    """10 after 9."""
    assert [name for name, _ in sorted_rows({"10": {}, "9": {}, "100": {}})] == ["9", "10", "100"]
    assert [name for name, _ in sorted_rows({"b": {}, "a": {}})] == ["a", "b"]


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1"])
def test_no_text_is_a_formula(text: str) -> None:
    """An order's name comes from a caller, and a spreadsheet would run it."""
    (found,) = read("orders", {text: {"why": text, "late_s": -3}})
    assert (found["order"], found["why"]) == ("'" + text, "'" + text)
    assert found["late_s"] == "-3"
    assert read("orders", {"a=1": {}})[0]["order"] == "a=1"


def test_what_cannot_be_encoded_is_replaced_and_many_rows_come_in_parts() -> None:
    """A half surrogate pair from JSON, commas, quotes and lines within a text."""
    rows = {f"{number:04d}": {"text": 'a,"b"\nc\ud800'} for number in range(1200)}
    parts = list(csv_parts("alarms", sorted_rows(rows)))
    assert len(parts) == 3
    found = list(csv.reader(io.StringIO(b"".join(parts).decode(), newline="")))
    assert len(found) == 1201
    assert found[1][3] == 'a,"b"\nc?'


def test_headers_are_told_once() -> None:
    """No table has one header twice."""
    for columns in TABLES.values():
        headers = [column.header for column in columns]
        assert len(set(headers)) == len(headers)

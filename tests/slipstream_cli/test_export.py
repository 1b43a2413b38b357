"""`slipstream export`: every row that was stored, and nothing of a file that was not finished."""

from __future__ import annotations

import csv
import json
import sqlite3
import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest

from slipstream_cli import export_files
from slipstream_cli.export_files import write_table
from slipstream_cli.main import main
from storage import TableColumn, open_database, open_reader, table_names
from tests.storage.conftest import PERIOD_NS, START_NS, Cycle, _cycle


@pytest.fixture
def url(tmp_path: Path) -> str:
    """A database of five cycles."""
    url = f"sqlite:///{tmp_path / 'a.db'}"
    with open_database(url) as database:
        for number in range(1, 6):
            database.record_cycle(*_cycle(number))
    return url


def rows_of(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_what_was_stored_is_what_the_csv_holds(url: str, tmp_path: Path) -> None:
    """JSON as text, times in ISO 8601 beside, nothing for NULL; every table has its file."""
    out = tmp_path / "out"
    assert main(["export", "all", "--database", url, "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {f"{name}.csv" for name in table_names()}
    cycles = rows_of(out / "cycles.csv")
    assert [row["cycle"] for row in cycles] == ["1", "2", "3", "4", "5"]
    assert cycles[0]["started_ns"] == str(START_NS + PERIOD_NS)
    assert cycles[0]["started_utc"] == "2026-09-21T14:13:50.000000000Z"
    assert cycles[0]["reason"] == ""
    assert json.loads(cycles[0]["unserved"])[1]["stop"] == "Käse_7 'north'"
    states = rows_of(out / "segment_states.csv")
    assert len(states) == 10
    assert json.loads(states[0]["features"])["mean_speed_mps"]["value"] == 15.2
    assert (states[1]["y_e"], states[1]["features"]) == ("", "")
    assert {row["repaired"] for row in rows_of(out / "solver_runs.csv")} == {"true", "false"}


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "'=1", "''-1"])
def test_no_text_of_a_csv_is_a_formula(tmp_path: Path, text: str) -> None:
    """An order's name comes from a caller, and a spreadsheet would run it; numbers stay."""
    columns = (TableColumn("order", "text"), TableColumn("late_s", "real"))
    write_table(tmp_path / "x.csv", columns, [[(text, -3.0), ("a=1", None), ("'s", 0.0)]])
    assert rows_of(tmp_path / "x.csv") == [
        {"order": f"'{text}", "late_s": "-3.0"},
        {"order": "a=1", "late_s": ""},
        {"order": "'s", "late_s": "0.0"},
    ]


@pytest.mark.slow
def test_the_database_s_commands_have_the_same_export(url: str, tmp_path: Path) -> None:
    """`db export` takes the options of `export`, and writes the same files."""
    begin = datetime.fromtimestamp((START_NS + 3 * PERIOD_NS) / 1e9, UTC).isoformat()
    for words in (["export"], ["db", "export"]):
        out = str(tmp_path / words[0])
        assert main([*words, "cycles", "--database", url, "--from", begin, "--out", out]) == 0
    assert [row["cycle"] for row in rows_of(tmp_path / "db/cycles.csv")] == ["3", "4", "5"]
    written = [(tmp_path / folder / "cycles.csv").read_bytes() for folder in ("export", "db")]
    assert written[0] == written[1]


@pytest.mark.slow
def test_parquet_holds_the_same_rows(url: str, tmp_path: Path) -> None:
    """With the columns' types, and times as timestamps in UTC."""
    parquet = pytest.importorskip("pyarrow.parquet")
    for form in export_files.FORMATS:
        arguments = ["--database", url, "--format", form, "--out", str(tmp_path)]
        assert main(["export", "plans", *arguments]) == 0
    table = parquet.read_table(tmp_path / "plans.parquet")
    texts = rows_of(tmp_path / "plans.csv")
    assert table.num_rows == len(texts) == 10
    assert table.column_names == list(texts[0])
    for name in ("issued", "depart"):
        assert str(table.schema.field(f"{name}_utc").type) == "timestamp[ns, tz=UTC]"
        moments = table.column(f"{name}_utc").cast("int64").to_pylist()
        assert moments == [int(text[f"{name}_ns"]) for text in texts]
    rows = table.select(["energy_kwh", "stops", "continues"]).to_pylist()
    for row, text in zip(rows, texts, strict=True):
        assert row["energy_kwh"] == float(text["energy_kwh"]) == 0.1 + 0.2
        assert json.loads(row["stops"]) == json.loads(text["stops"])
        assert row["continues"] is None


def test_a_range_takes_the_rows_of_its_cycles(url: str, tmp_path: Path) -> None:
    """From the first moment on, up to the last one without it."""

    def moment(cycle: int) -> str:
        return datetime.fromtimestamp((START_NS + cycle * PERIOD_NS) / 1e9, UTC).isoformat()

    arguments = ["--database", url, "--out", str(tmp_path), "--from", moment(2), "--to", moment(4)]
    assert main(["export", "all", *arguments]) == 0
    for name in ("cycles", "gates", "plans", "segment_states", "solver_runs"):
        assert {row["cycle"] for row in rows_of(tmp_path / f"{name}.csv")} == {"2", "3"}, name


def test_an_export_is_of_one_moment_while_the_dispatcher_writes(url: str) -> None:
    """Cycles stored in the middle of it are in none of its tables; rows come in batches."""
    with open_database(url) as database, open_reader(url) as reader, reader.tables() as tables:
        batches = tables.rows("cycles", batch=2)
        seen = [list(next(batches))]
        late: Cycle = _cycle(6)
        database.record_cycle(*late)
        seen += [list(batch) for batch in batches]
        assert [[row[0] for row in batch] for batch in seen] == [[1, 2], [3, 4], [5]]
        plans = [row for batch in tables.rows("plans", batch=3) for row in batch]
        assert {row[0] for row in plans} == {1, 2, 3, 4, 5}


def test_a_file_that_is_there_stays_as_it_is(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Until --force is given; no other table is written either."""
    kept = tmp_path / "plans.csv"
    kept.write_text("mine")
    arguments = ["export", "all", "--database", url, "--out", str(tmp_path)]
    assert main(arguments) == 2
    assert "plans.csv: is there already; give --force" in capsys.readouterr().err
    assert kept.read_text() == "mine"
    assert not (tmp_path / "cycles.csv").exists()
    assert main([*arguments, "--force"]) == 0
    assert kept.read_text() != "mine"


def test_an_export_that_fails_leaves_no_file(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half a table could be taken for all of it."""

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(export_files, "_cells", full)
    out = tmp_path / "out"
    assert main(["export", "cycles", "--database", url, "--out", str(out)]) == 1
    assert list(out.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["cycles", "--from", "yesterday"], "export: --from: 'yesterday' is no time"),
        (["cycles", "--from", "2026-11-24", "--to", "2026-11-23"], "the range is empty"),
        (["sqlite_master"], "no table 'sqlite_master'; use all, or one of: clock, cycles"),
        (["cycles", "--database", "sqlite:///none.db"], "none.db: no database there"),
    ],
)
def test_a_mistake_is_one_line(
    url: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    line: str,
) -> None:
    """It says what to write instead, and makes nothing."""
    out = tmp_path / "out"
    table, *more = arguments
    assert main(["export", table, "--database", url, "--out", str(out), *more]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_parquet_without_pyarrow_names_the_extra(
    url: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In one line, before anything is written."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    out = tmp_path / "out"
    arguments = ["export", "all", "--database", url, "--format", "parquet", "--out", str(out)]
    assert main(arguments) == 2
    assert "pip install 'slipstream[parquet]'" in capsys.readouterr().err
    assert not out.exists()


def test_a_damaged_row_is_named(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One value that is none ends the table, in one line."""
    with sqlite3.connect(url.removeprefix("sqlite:///")) as connection:
        connection.execute("UPDATE cycles SET started_ns = 'soon' WHERE cycle = 3")
    out = tmp_path / "out"
    assert main(["export", "cycles", "--database", url, "--out", str(out)]) == 2
    assert "a row cannot be read" in capsys.readouterr().err
    assert list(out.iterdir()) == []

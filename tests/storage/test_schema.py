"""Migrations lead from nothing to exactly the models."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import msgspec
import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

import storage
from storage import schema
from storage.engine import parse_url, writer_engine
from storage.models import Base


def test_head_equals_the_models(any_url):
    """Upgrading an empty database gives the tables, columns and indexes of the models."""
    storage.open_database(any_url).close()
    engine = writer_engine(parse_url(any_url))
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, Base.metadata) == []
        assert schema.current(connection) == schema.head()
    engine.dispose()


def test_one_line_of_revisions():
    """There is one head, reached from one base."""
    script = ScriptDirectory(str(schema.MIGRATIONS))
    assert len(script.get_heads()) == 1
    assert len(script.get_bases()) == 1


def test_a_broken_upgrade_leaves_nothing(url, monkeypatch):
    """An upgrade that fails half-way leaves an empty database, which the next one brings up."""
    from alembic import op

    create_table = op.create_table

    def fail_at_plans(name, *columns, **options):
        if name == "plans":
            raise RuntimeError("power cut")
        return create_table(name, *columns, **options)

    with monkeypatch.context() as patch:
        patch.setattr(op, "create_table", fail_at_plans)
        with pytest.raises(RuntimeError, match="power cut"):
            storage.open_database(url)
    connection = sqlite3.connect(url.removeprefix("sqlite:///"))
    assert connection.execute("SELECT name FROM sqlite_master").fetchall() == []
    connection.close()
    with storage.open_database(url) as database:
        assert database.next_cycle_number() == 1


TABLES = ("cycles", "solver_runs", "gates", "plans", "segment_states")


def _insert(connection, table: str, row) -> None:
    marks = ", ".join(f":{name}" for name in row)
    connection.execute(f"INSERT INTO {table} ({', '.join(row)}) VALUES ({marks})", row)


def _at_0001(url, tmp_path, cycles) -> None:
    """Make a database as the first version left it: its schema, and rows in its columns only."""
    newest = tmp_path / "newest.db"
    with storage.open_database(f"sqlite:///{newest}") as database:
        for cycle in cycles:
            database.record_cycle(*cycle)
    Path(url.removeprefix("sqlite:///")).parent.mkdir(parents=True)
    config = Config()
    config.set_main_option("script_location", str(schema.MIGRATIONS))
    engine = writer_engine(parse_url(url))
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "0001")
    engine.dispose()
    old = sqlite3.connect(url.removeprefix("sqlite:///"))
    old.execute("ATTACH ? AS newest", (str(newest),))
    for table in ("cycles", "solver_runs", "plans"):
        names = ", ".join(row[1] for row in old.execute(f"PRAGMA main.table_info({table})"))
        old.execute(f"INSERT INTO main.{table} ({names}) SELECT {names} FROM newest.{table}")
    for report, _, states in cycles:
        for place, gate in enumerate(report.gates):
            _insert(old, "gates", {"cycle": report.cycle, "position": place, **gate.model_dump()})
        for state in states:
            row = {"cycle": report.cycle, **msgspec.to_builtins(state)}
            row["features"] = None if state.features is None else json.dumps(row["features"])
            _insert(old, "segment_states", row)
    old.commit()
    old.close()


def _as_of_0001(report):
    """A report as its first version kept it."""
    none = dict.fromkeys(("backend", "backend_kind", "fallback", "two_qubit_depth"))
    solvers = tuple(run.model_copy(update=none) for run in report.solvers)
    times = ("baseline_driving_s", "cooperative_driving_s", "price_of_time_kw")
    energy = report.energy.model_copy(update=dict.fromkeys(times))
    changed = {"unserved": (), "solvers": solvers, "energy": energy, "carriers": ()}
    return report.model_copy(update=changed)


def _dump(url) -> dict[str, list[tuple[object, ...]]]:
    connection = sqlite3.connect(url.removeprefix("sqlite:///"))
    try:
        return {table: connection.execute(f"SELECT * FROM {table}").fetchall() for table in TABLES}
    finally:
        connection.close()


def test_upgrade_from_0001_keeps_every_row(url, tmp_path, make_cycle):
    """A database of the first version keeps all it holds, and its cycles leave no stop out."""
    cycles = [make_cycle(number) for number in (1, 2, 3)]
    _at_0001(url, tmp_path, cycles)
    before = _dump(url)
    assert [len(before[table]) for table in TABLES] == [3, 6, 6, 6, 6]
    with storage.open_reader(url) as reader, pytest.raises(storage.StorageError, match="upgraded"):
        reader.latest_cycle()
    assert not storage.check(url).ok

    with storage.open_database(url) as database, storage.open_reader(url) as reader:
        assert storage.check(url).ok
        expected = tuple(_as_of_0001(report) for report, _, _ in cycles)
        assert reader.cycles(limit=9) == expected
        assert reader.latest_plans() == tuple(cycles[-1][1])
        assert reader.states(2) == tuple(cycles[1][2])
        assert database.next_cycle_number() == 4
        database.record_cycle(*make_cycle(4))
        assert reader.latest_cycle() == make_cycle(4)[0]
        after = _dump(url)
    for table in TABLES[1:]:
        # Columns that came later are empty.
        kept = [row[: len(old)] for row, old in zip(after[table], before[table], strict=False)]
        assert kept == before[table]


def test_a_broken_upgrade_from_0001_changes_nothing(url, tmp_path, make_cycle, monkeypatch):
    """An upgrade of a filled database that fails leaves it as it was; the next one succeeds."""
    from alembic import op

    _at_0001(url, tmp_path, [make_cycle(1)])
    before = _dump(url)
    add_column = op.add_column

    def fail_after(table, column):
        add_column(table, column)
        raise RuntimeError("power cut")

    with monkeypatch.context() as patch:
        patch.setattr(op, "add_column", fail_after)
        with pytest.raises(RuntimeError, match="power cut"):
            storage.open_database(url)
    assert _dump(url) == before
    with storage.open_database(url) as database:
        assert database.next_cycle_number() == 2

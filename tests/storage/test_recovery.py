"""Backups of a database in use, restores that lose nothing, and damaged files set aside."""

from __future__ import annotations

import logging
import os
import sqlite3
import threading
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

import storage
from slipstream.errors import InputError
from slipstream.orders import FleetRecords, OrderRecord
from slipstream_cli.main import main
from storage.retention import reserve_path
from tests.storage.conftest import PAUSED, RAISED


def _path(url: str) -> Path:
    return Path(url.removeprefix("sqlite:///"))


def _numbers(url: str) -> list[int]:
    with storage.open_reader(url) as reader:
        return [report.cycle for report in reader.cycles(limit=10_000)]


def _fill(url, make_cycle, cycles: int) -> None:
    with storage.open_database(url, owned=True) as database:
        for number in range(1, cycles + 1):
            database.record_cycle(*make_cycle(number))


@pytest.mark.slow
def test_a_backup_of_a_database_that_is_written(url, make_cycle, tmp_path):
    """Every copy taken beside a busy dispatcher is sound and has all cycles up to its moment."""
    done, last = threading.Event(), [0]
    with storage.open_database(url, owned=True) as database:
        database.record_cycle(*make_cycle(1))

        def write() -> None:
            number = 1
            while not done.is_set():
                number += 1
                database.record_cycle(*make_cycle(number))
                last[0] = number

        writer = threading.Thread(target=write)
        writer.start()
        try:
            for copy in range(5):
                file = tmp_path / f"backup-{copy}.db"
                before = last[0]
                report = storage.backup(url, file)
                assert report.ok
                assert _numbers(f"sqlite:///{file}") == list(range(1, report.cycles + 1))
                assert report.cycles >= before
        finally:
            done.set()
            writer.join()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *(f"backup-{copy}.db" for copy in range(5)),
        "state",
    ]


@pytest.mark.slow
def test_backup_and_restore_by_command(url, make_cycle, tmp_path, capsys):
    """What was there is kept, numbers go on above both, and the restored file starts."""
    _fill(url, make_cycle, 3)
    file = tmp_path / "backup.db"
    assert main(["db", "backup", str(file), "--url", url]) == 0
    assert "3 cycles" in capsys.readouterr().out
    with storage.open_database(url, owned=True) as database:
        for number in (4, 5):
            database.record_cycle(*make_cycle(number))
        assert main(["db", "restore", str(file), "--url", url]) == 2
        assert "another dispatcher" in capsys.readouterr().err
    content = _numbers(url)
    assert main(["db", "restore", str(file), "--url", url]) == 0
    (former,) = _path(url).parent.glob("*-before-restore-*Z")
    assert str(former) in capsys.readouterr().out
    assert _numbers(f"sqlite:///{former}") == content == [1, 2, 3, 4, 5]
    with storage.open_database(url, owned=True) as database:
        assert database.next_cycle_number() == 7
        assert _numbers(url) == [1, 2, 3, 6]
    with storage.open_reader(url) as reader:
        assert "restored from the backup" in reader.latest_cycle().reason
    assert main(["db", "restore", str(file), "--url", f"sqlite:///{tmp_path}/new.db"]) == 0
    assert _numbers(f"sqlite:///{tmp_path}/new.db") == [1, 2, 3]


def test_a_restored_backup_keeps_its_schema(url, make_cycle, tmp_path):
    """The release before, whose it is, takes it; a newer one brings it up when it starts."""
    _fill(url, make_cycle, 3)
    with closing(sqlite3.connect(_path(url))) as connection, connection:
        connection.execute("DROP TABLE segment_counts")
        connection.execute("UPDATE alembic_version SET version_num = '0021'")
    file = tmp_path / "backup.db"
    storage.backup(url, file)
    with storage.open_database(url) as database:
        database.record_cycle(*make_cycle(4))
    storage.restore(url, file)
    assert storage.check(url).schema_version == "0021"
    with closing(sqlite3.connect(_path(url))) as connection:
        cycles = connection.execute("SELECT cycle, reason FROM cycles ORDER BY cycle").fetchall()
    assert [cycle for cycle, _ in cycles] == [1, 2, 3, 5]
    assert cycles[-1][1] == "restored from the backup backup.db"
    with storage.open_database(url) as database:
        assert database.next_cycle_number() == 6
    assert storage.check(url).schema_version == storage.schema.HEAD


@pytest.mark.slow
def test_bad_backups_change_nothing(url, make_cycle, tmp_path):
    """Nothing is overwritten by a backup, nothing replaced by what is no sound backup."""
    _fill(url, make_cycle, 40)
    before = _path(url).read_bytes()
    file, damaged, text = tmp_path / "backup.db", tmp_path / "damaged.db", tmp_path / "text.db"
    storage.backup(url, file)
    damaged.write_bytes(_damaged(file.read_bytes()))
    text.write_text("Dear diary" * 1000)
    kept = file.read_bytes()
    server = "postgresql://me:geheim@db.example/slipstream"
    for call, line in (
        (lambda: storage.backup(url, file), "is there already"),
        (lambda: storage.backup(url, tmp_path / "none" / "x.db"), "no such folder"),
        (lambda: storage.backup(f"sqlite:///{tmp_path}/none.db", tmp_path / "x"), "no such file"),
        (lambda: storage.backup(f"sqlite:///{damaged}", tmp_path / "x"), "malformed|is damaged"),
        (lambda: storage.backup(f"sqlite:///{text}", tmp_path / "x"), "not a database|cannot be"),
        (lambda: storage.backup(server, tmp_path / "x"), r"pg_dump .*postgresql://me@db.example/"),
        (lambda: storage.restore(url, damaged), "malformed|is damaged"),
        (lambda: storage.restore(url, text), "not a database"),
        (lambda: storage.restore(url, tmp_path / "none.db"), "no such file"),
        (lambda: storage.restore(url, _path(url)), "the database itself"),
        (lambda: storage.restore(server, file), "pg_restore"),
    ):
        with pytest.raises((InputError, storage.StorageError), match=line) as caught:
            call()
        assert "geheim" not in str(caught.value)
    assert file.read_bytes() == kept
    assert _path(url).read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {
        "backup.db",
        "damaged.db",
        "state",
        "text.db",
    }


def _damaged(data: bytes) -> bytes:
    """A page of its middle is another one."""
    middle = len(data) // 8192 * 4096
    return data[:middle] + b"\x55" * 4096 + data[middle + 4096 :]


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("how", ["a page", "the header", "cut"])
def test_a_damaged_file_is_set_aside(url, make_cycle, how, caplog):
    """It is kept byte for byte, the new one's numbers are above all of before, and it says so."""
    _fill(url, make_cycle, 60)
    path = _path(url)
    data = path.read_bytes()
    data = {"a page": _damaged(data), "the header": bytes(100) + data[100:], "cut": data[:9000]}[
        how
    ]
    path.write_bytes(data)
    with caplog.at_level(logging.ERROR), storage.open_or_set_aside(url) as database:
        assert database.set_aside is not None
        assert database.set_aside.name.startswith("slipstream.db-corrupt-2")
        assert database.set_aside.read_bytes() == data
        number = database.next_cycle_number()
        assert number > 61
        report, plans, states = make_cycle(1)
        plans = [plan.model_copy(update={"cycle": number}) for plan in plans]
        database.record_cycle(report.model_copy(update={"cycle": number}), plans, states)
    assert "set aside as slipstream.db-corrupt" in caplog.text
    assert storage.check(url).ok
    with storage.open_reader(url) as reader:
        told, _ = reader.cycles(limit=2)
        assert told.status == "failed"
        assert "the database of before" in told.reason
    # A second start finds nothing to do, and a second damage has another name.
    with storage.open_or_set_aside(url) as database:
        assert database.set_aside is None
        assert database.next_cycle_number() == number + 1
    path.write_bytes(_damaged(path.read_bytes()))
    storage.open_or_set_aside(url).close()
    assert len(list(path.parent.glob("*-corrupt-*"))) >= 2


@pytest.mark.slow
def test_orders_and_plans_survive_damage_elsewhere(url, make_cycle, tmp_path):
    """Orders and plans in force that can be read are those that a restart would have loaded."""
    order = OrderRecord(
        order="o1",
        node="c1",
        service_s=60.0,
        demand=1,
        earliest_ns=None,
        latest_ns=None,
        state="served",
        since_ns=make_cycle(60)[0].started_ns,
        reason="served",
        vehicle="van-a",
        cycle=60,
        listed=True,
    )
    with storage.open_database(url, owned=True) as database:
        for number in range(1, 61):
            records = FleetRecords(orders=(order,)) if number == 60 else None
            database.record_cycle(*make_cycle(number), records)
        loaded = database.load_fleet(0)
        ended = replace(RAISED, alarm="0b", ended_ns=RAISED.time_ns + 1)
        database.save_events([ended, RAISED, PAUSED])
        with database._raw() as cursor:
            root = "SELECT rootpage FROM sqlite_master WHERE name = 'solver_runs'"
            page = cursor.execute(root).fetchone()[0]
    assert {record.plan.cycle for record in loaded.plans} >= {60}
    path = _path(url)
    with path.open("r+b") as file:
        file.seek((page - 1) * 4096)
        file.write(os.urandom(4096))
    with storage.open_or_set_aside(url) as database:
        assert database.set_aside is not None
        after = database.load_fleet(0)
        assert after.orders == (order,)
        assert after.plans == loaded.plans
        assert database.last_event(["pause"]) == replace(PAUSED, number=2)
        assert database.load_alarms(0) == (replace(RAISED, number=1),)
        assert database.next_cycle_number() == 60 + 1000 + 1


@pytest.mark.slow
def test_a_file_that_no_dispatcher_wrote_is_left_alone(url, make_cycle):
    """A wrong path is refused: the file stays where it is."""
    path = _path(url)
    path.parent.mkdir()
    path.write_text("Dear diary" * 1000)
    for _ in range(2):
        with pytest.raises(InputError, match="not a database"):
            storage.open_or_set_aside(url)
    assert path.read_text() == "Dear diary" * 1000
    path.unlink()
    _fill(url, make_cycle, 30)
    reserve_path(path).unlink()
    data = _damaged(path.read_bytes())
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"damaged|malformed"):
        storage.open_or_set_aside(url)
    assert path.read_bytes() == data

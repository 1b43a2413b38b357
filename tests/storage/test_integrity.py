"""The check finds a sound database sound and a damaged one damaged."""

from __future__ import annotations

import random
import sqlite3
from collections import Counter
from contextlib import closing
from pathlib import Path

import pytest

import storage
from slipstream.errors import InputError
from slipstream.orders import utc
from slipstream_cli.main import main


@pytest.mark.slow
def test_sound(url, make_cycle):
    """A database in use is sound, and the report has its cycles."""
    with storage.open_database(url) as database:
        for number in (1, 2, 3):
            database.record_cycle(*make_cycle(number))
        report = storage.check(url)
    assert report.ok
    assert report.cycles == 3
    assert (report.first_ns, report.last_ns) == (
        make_cycle(1)[0].started_ns,
        make_cycle(3)[0].started_ns,
    )
    assert report.schema_version == report.schema_head


@pytest.mark.slow
def test_damaged_page(url, make_cycle, capsys):
    """Bytes overwritten in the middle of the file are found."""
    with storage.open_database(url) as database:
        for number in range(1, 60):
            database.record_cycle(*make_cycle(number))
    path = Path(url.removeprefix("sqlite:///"))
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2 // 4096 * 4096)
        file.write(b"\x55" * 4096)
    report = storage.check(url)
    assert not report.ok
    assert report.faults
    assert main(["db", "check", "--url", url]) == 1
    line = capsys.readouterr().out
    assert line.startswith(f"{path}: damaged: {report.faults[0]}")
    assert line.endswith("slipstream db restore\n")


@pytest.mark.parametrize("content", [None, b"diary " * 200])
def test_nothing_to_check(tmp_path, content):
    """A missing file and one that is no database give an error of one line."""
    path = tmp_path / "x.db"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"no such file|not a database") as caught:
        storage.check(f"sqlite:///{path}")
    assert caught.value.source == str(path)


def test_never_set_up(tmp_path):
    """An empty file passes for a database without a schema: not ok, and not an error."""
    path = tmp_path / "x.db"
    path.touch()
    report = storage.check(f"sqlite:///{path}")
    assert not report.ok
    assert report.schema_version is None


def test_the_command_says_it_in_a_sentence(url, make_cycle, tmp_path, capsys, monkeypatch):
    """Sound with its cycles, of an older schema with what to run, damaged with the first fault."""
    path = Path(url.removeprefix("sqlite:///"))

    def told(where=url):
        status = main(["db", "check", "--url", where])
        line = capsys.readouterr().out
        assert line.count("\n") == 1
        return status, line.rstrip()

    with storage.open_database(url) as database:
        for number in (1, 2):
            database.record_cycle(*make_cycle(number))
    head = storage.check(url).schema_head
    begins, ends = (utc(make_cycle(number)[0].started_ns) for number in (1, 2))
    size = f"{path.stat().st_size / 1e6:.1f} MB"
    sound = f"{path}: sound, schema {head}, 2 cycles from {begins} to {ends}, {size}"
    assert told() == (0, sound)
    with monkeypatch.context() as patch:
        patch.setattr("storage.schema.HEAD", "0999")
        status, line = told()
        refused = pytest.raises(storage.StorageError, match="has not upgraded it yet")
        with storage.open_reader(url) as reader, refused:
            reader.latest_cycle()
    assert status == 1
    assert f"schema {head}, where this version has 0999: run slipstream db upgrade" in line
    (tmp_path / "empty.db").touch()
    status, line = told(f"sqlite:///{tmp_path / 'empty.db'}")
    assert (status, line.partition(": ")[2]) == (1, "no schema yet; run slipstream db upgrade")


PAGE = 4096


def _damage(data: bytearray, seed: int) -> str:
    """Damage a database's bytes in place in one of five ways; returns which."""
    moments = random.Random(seed)
    kind = moments.choice(("bits", "bytes", "cut", "swap", "zeros"))
    if kind == "bits":
        for _ in range(moments.choice((1, 1, 2, 8, 64))):
            data[moments.randrange(len(data))] ^= 1 << moments.randrange(8)
    elif kind == "bytes":
        for _ in range(moments.choice((1, 4, 64))):
            data[moments.randrange(len(data))] = moments.randrange(256)
    elif kind == "cut":
        del data[moments.randrange(len(data)) :]
    else:
        first, second = (PAGE * n for n in moments.sample(range(len(data) // PAGE), 2))
        page = bytes(data[first : first + PAGE])
        data[first : first + PAGE] = data[second : second + PAGE] if kind == "swap" else bytes(PAGE)
        if kind == "swap":
            data[second : second + PAGE] = page
    return kind


def _read_all(url: str) -> None:
    """Read as the dashboard does; what cannot be read is a StorageError of one line."""
    with storage.open_reader(url) as reader:
        for read in (
            reader.latest_cycle,
            reader.latest_plan_records,
            lambda: reader.cycles(limit=50),
            lambda: reader.states(3),
            lambda: reader.jobs(limit=9),
        ):
            try:
                read()
            except storage.StorageError as error:
                assert "\n" not in str(error)  # noqa: PT017


def _start(url: str, cycle) -> bool:
    """Start on a database and record a cycle as the dispatcher does; False if it is refused."""
    try:
        database = storage.open_database(url, owned=True)
    except (InputError, storage.StorageError) as error:
        assert "\n" not in str(error)  # noqa: PT017
        return False
    with database:
        try:
            report, plans, states = cycle
            number = database.next_cycle_number()
            report = report.model_copy(update={"cycle": number})
            plans = [plan.model_copy(update={"cycle": number}) for plan in plans]
            database.jobs_since(0)
            database.record_cycle(report, plans, states)
            database.trim(100.0, limit=50)
        except (storage.StorageError, ValueError):
            # Content that is no cycle's, in a file that is sound: it costs the cycle.
            pass
    return True


def _quick_check(path: Path) -> bool:
    """What SQLite's shorter check would have said."""
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as connection:
            return [row[0] for row in connection.execute("PRAGMA quick_check")] == ["ok"]
    except (sqlite3.Error, UnicodeDecodeError):
        return False


@pytest.mark.attack
@pytest.mark.timeout(3600)
@pytest.mark.long
def test_no_damage_is_a_traceback(tmp_path, make_cycle, capsys, full_size, figure):
    """Nothing starts on what the check calls bad; check, prune, start and readers say one line."""
    whole = tmp_path / "whole.db"
    with storage.open_database(f"sqlite:///{whole}") as database:
        for number in range(1, 31):
            database.record_cycle(*make_cycle(number))
    sound = whole.read_bytes()
    folder = tmp_path / "damaged"
    folder.mkdir()
    path = folder / "slipstream.db"
    url = f"sqlite:///{path}"
    found: Counter[str] = Counter()
    for seed in range(2000 if full_size else 60):
        for file in folder.iterdir():
            file.unlink()
        data = bytearray(sound)
        kind = _damage(data, seed)
        path.write_bytes(data)
        _read_all(url)
        bad = main(["db", "check", "--url", url]) != 0
        quick = _quick_check(path)
        started = _start(url, make_cycle(31))
        assert not (bad and started), f"seed {seed}: started on what the check calls bad"
        assert main(["db", "prune", "--url", url, "--keep-mb", "0"]) in (0, 1, 2)
        _read_all(url)
        found[f"{kind} found" if bad else f"{kind} not found"] += 1
        found["not found by quick_check"] += bad and quick
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith("slipstream: ") for line in lines)
    assert sum(count for what, count in found.items() if what.endswith(" found")) > 30
    figure(", ".join(f"{what}: {count}" for what, count in sorted(found.items())))


def test_a_value_that_is_no_message_is_one_line(url, make_cycle):
    """Damage inside a value passes the check of the file; readers say so in one line."""
    with storage.open_database(url) as database:
        database.record_cycle(*make_cycle(1))
        path = Path(url.removeprefix("sqlite:///"))
        for change in ("plans SET stops = '[{'", "plans SET vehicle = ''", "plans SET stops = 5"):
            with closing(sqlite3.connect(path)) as connection:
                connection.execute(f"UPDATE {change} WHERE vehicle = 'van-a'")
                connection.commit()
            assert storage.check(url).ok
            with (
                storage.open_reader(url) as reader,
                pytest.raises(storage.StorageError, match="a row cannot be read") as caught,
            ):
                tuple(r.plan for r in reader.latest_plan_records())
            assert "\n" not in str(caught.value)
            with closing(sqlite3.connect(path)) as connection:
                connection.execute("DELETE FROM cycles")
                connection.execute("DELETE FROM plans")
                connection.execute("DELETE FROM solver_runs")
                connection.execute("DELETE FROM gate_changes")
                connection.execute("DELETE FROM cycle_traffic")
                connection.commit()
            database.record_cycle(*make_cycle(1))

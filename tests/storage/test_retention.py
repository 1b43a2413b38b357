"""What is deleted, when, and that deleting works where it is needed most: on a full disk."""

from __future__ import annotations

import os
import random
import subprocess
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec
import pytest
from sqlalchemy import text

import storage
from slipstream.errors import InputError
from slipstream.messages import Estimate
from slipstream_cli.main import main
from storage import retention

DAY_NS = 86_400_000_000_000
PERIOD_NS = DAY_NS // 6


def _at(cycle, number, started_ns):
    """A cycle of another number and time."""
    report, plans, states = cycle
    return (
        report.model_copy(update={"cycle": number, "started_ns": started_ns}),
        [plan.model_copy(update={"cycle": number}) for plan in plans],
        states,
    )


def _city(cycle, segments):
    """A cycle with gates and states of so many segments."""
    report, plans, states = cycle
    names = [f"segment_{number:04d}" for number in range(segments)]
    gates = tuple(report.gates[0].model_copy(update={"segment": name}) for name in names)
    measured = random.Random(1)

    def vary(state, name):
        """A state with figures of its own, so that it takes as much room as a measured one."""
        figures = {
            feature: Estimate(value=measured.random(), standard_error=measured.random())
            for feature in type(state.features).__struct_fields__
        }
        features = msgspec.structs.replace(state.features, **figures)
        return msgspec.structs.replace(state, segment=name, features=features)

    return (
        report.model_copy(update={"gates": gates}),
        plans,
        [vary(states[0], name) for name in names],
    )


def _fill(database, make_cycle, first, last, end_ns):
    """Record cycles of four hours each that end at a time."""
    cycle = make_cycle(1)
    for number in range(first, last + 1):
        database.record_cycle(*_at(cycle, number, end_ns - (last - number) * PERIOD_NS))


def _bytes(path: Path) -> int:
    return sum(file.stat().st_size for file in path.parent.glob(f"{path.name}*"))


def _path(url: str) -> Path:
    return Path(url.removeprefix("sqlite:///"))


def _stored(url: str) -> list[int]:
    with storage.open_reader(url) as reader:
        return [report.cycle for report in reader.cycles(limit=100_000)]


@pytest.mark.attack
@pytest.mark.long
def test_a_clock_that_jumped_ahead_deletes_nothing(url, make_cycle):
    """Neither at once, nor when its own cycles are the newest ones, nor after a restart."""
    right_ns = make_cycle(1)[0].started_ns
    wrong_ns = right_ns + 400 * DAY_NS
    with storage.open_database(url) as database:
        _fill(database, make_cycle, 1, 624, right_ns)
        # 104 days of cycles: a normal prune deletes the first two weeks.
        assert database.prune(90.0, right_ns) == 624 - 90 * 6 - 1
        stored = _stored(url)
    for start in range(3):
        with storage.open_database(url) as database:
            for again in range(3):
                number = 625 + 3 * start + again
                now_ns = wrong_ns + number * PERIOD_NS
                database.record_cycle(*_at(make_cycle(1), number, now_ns))
                with pytest.raises(storage.UntrustedClockError, match="days ahead of") as caught:
                    database.prune(90.0, now_ns)
                assert "--trust-clock" in caught.value.mend
    assert _stored(url) == [*stored, *range(625, 634)]
    # The clock is mended: deletion goes on, and nothing but what is too old is lost.
    with storage.open_database(url) as database:
        database.record_cycle(*_at(make_cycle(1), 634, right_ns + DAY_NS))
        assert database.prune(90.0, right_ns + DAY_NS) == 6
    assert _stored(url) == [*stored[6:], *range(625, 635)]


@pytest.mark.attack
def test_a_clock_that_was_told_to_be_right_deletes(url, make_cycle):
    """After a long stop the operator's word lets deletion by age go on, restarts included."""
    right_ns = make_cycle(1)[0].started_ns
    later_ns = right_ns + 100 * DAY_NS
    with storage.open_database(url) as database:
        _fill(database, make_cycle, 1, 12, right_ns)
        with pytest.raises(storage.UntrustedClockError):
            database.prune(99.0, later_ns)
        database.trust_clock(later_ns)
    with storage.open_database(url) as database:
        assert database.prune(99.0, later_ns) == 11


def test_a_short_stop_is_no_jump(url, make_cycle):
    """A clock that is a few days ahead is trusted, and each cycle moves the trust on."""
    right_ns = make_cycle(1)[0].started_ns
    with storage.open_database(url) as database:
        for number in range(1, 5):
            now_ns = right_ns + int(number * (retention.MAX_CLOCK_GAP_DAYS - 0.5) * DAY_NS)
            database.record_cycle(*_at(make_cycle(1), number, now_ns))
            database.prune(90.0, now_ns)
        gap_ns = int((retention.MAX_CLOCK_GAP_DAYS + 0.1) * DAY_NS)
        with pytest.raises(storage.UntrustedClockError):
            database.prune(90.0, now_ns + gap_ns)


@pytest.mark.slow
@pytest.mark.attack
def test_cycles_of_a_clock_that_was_behind_stay(url, make_cycle):
    """Cycles dated 1970 among those of today are not old, once the clock is right again."""
    right_ns = make_cycle(1)[0].started_ns
    with storage.open_database(url) as database:
        _fill(database, make_cycle, 1, 12, right_ns)
        for number in (13, 14):
            database.record_cycle(*_at(make_cycle(1), number, number))
            assert database.prune(1.0, number) == 0
        database.record_cycle(*_at(make_cycle(1), 15, right_ns + PERIOD_NS))
        # A day is six cycles: 10 to 12 and 15 are young, and those between them count as young.
        assert database.prune(4 / 6, right_ns + PERIOD_NS) == 8
        assert _stored(url) == [9, 10, 11, 12, 13, 14, 15]
        # All that were before have become too old, and so have they.
        assert database.prune(4 / 6, right_ns + 5 * PERIOD_NS) == 6
    assert _stored(url) == [15]


def test_an_empty_database_has_no_trusted_time(url, make_cycle):
    """Until its first cycle, which gives it one."""
    right_ns = make_cycle(1)[0].started_ns
    with storage.open_database(url) as database:
        assert database.prune(90.0, right_ns) == 0
        database.record_cycle(*make_cycle(1))
        with pytest.raises(storage.UntrustedClockError):
            database.prune(90.0, right_ns + 400 * DAY_NS)


def _copy(database, number: int) -> None:
    """Record a copy of cycle 1 by SQL: as large, and twenty times as fast."""
    tables = ("cycles", "solver_runs", "plans", "cycle_traffic")
    with database._write_session() as session:
        for table in tables:
            names = [row[1] for row in session.execute(text(f"PRAGMA table_info({table})"))]
            values = [str(number) if name == "cycle" else name for name in names]
            session.execute(
                text(
                    f"INSERT INTO {table} ({', '.join(names)}) "
                    f"SELECT {', '.join(values)} FROM template.{table}"
                )
            )


@pytest.mark.attack
@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_size_is_bounded(url, make_cycle, tmp_path, monkeypatch, full_size, figure):
    """Ten thousand cycles of a thousand segments: all files together never exceed the limit."""
    cycles, segments, keep_mb, sampled = (
        (10_000, 1_000, 1000.0, 200) if full_size else (150, 100, 1.5, 10)
    )
    if not full_size:
        monkeypatch.setattr(retention, "LOG_BYTES", 300_000)
        monkeypatch.setattr(retention, "RESERVE_BYTES", 100_000)
        monkeypatch.setattr("storage.engine.LOG_LIMIT_BYTES", 100_000)
    template = tmp_path / "template.db"
    with storage.open_database(f"sqlite:///{template}") as database:
        database.record_cycle(*_city(make_cycle(1), segments))
    largest, deleted, longest_s = 0, 0, 0.0
    with storage.open_database(url, owned=True) as database:
        with database._raw() as cursor:
            cursor.execute("ATTACH ? AS template", (str(template),))
            if not full_size:
                cursor.execute("PRAGMA wal_autocheckpoint = 20")
        for number in range(1, cycles + 1):
            if number % sampled == 0:
                report, plans, states = _at(_city(make_cycle(1), segments), number, number)
                database.record_cycle(report, plans, states)
            else:
                _copy(database, number)
            began = time.monotonic()
            deleted += database.trim(keep_mb, limit=50)
            longest_s = max(longest_s, time.monotonic() - began)
            largest = max(largest, _bytes(_path(url)))
        assert largest <= keep_mb * 1e6
        with database._raw() as cursor:
            cursor.execute("DETACH template")
    stored = _stored(url)
    assert stored == list(range(cycles - len(stored) + 1, cycles + 1))
    assert len(stored) + deleted == cycles
    assert largest > 0.7 * keep_mb * 1e6
    assert storage.check(url).faults == ()
    figure(
        f"{cycles} cycles of {segments} segments: {largest / 1e6:.1f} of {keep_mb:g} MB at most, "
        f"{len(stored)} cycles stay; the longest deletion of a cycle took {longest_s:.2f} s"
    )


@pytest.mark.long
@pytest.mark.attack
def test_a_lower_limit_is_reached_in_small_steps(url, make_cycle, monkeypatch):
    """A file that is far too large loses a bounded number of cycles a call, and then shrinks."""
    monkeypatch.setattr(retention, "LOG_BYTES", 0)
    monkeypatch.setattr(retention, "RESERVE_BYTES", 0)
    monkeypatch.setattr(retention, "BATCH_BYTES", 40_960)
    cycle = _city(make_cycle(1), 100)
    with storage.open_database(url) as database:
        for number in range(1, 121):
            database.record_cycle(*_at(cycle, number, number))
        before = database._pages()
        target = before.count * before.size / 4
        calls = []
        while database._pages().count * 4096 > target and len(calls) < 60:
            number += 1
            database.record_cycle(*_at(cycle, number, number))
            calls.append(database.trim(target / 1e6, limit=10))
            assert database._pages().used <= before.used
        assert 0 < max(calls) < 20
        assert len(calls) < 60
    stored = _stored(url)
    assert stored == list(range(stored[0], number + 1))
    with storage.open_database(url) as database:
        assert database.trim(0.0) == len(stored) - 1
    assert _stored(url) == [number]


@pytest.mark.parametrize("size", [-1.0, float("nan"), float("inf")])
def test_sizes_that_are_none_are_refused(url, make_cycle, size):
    """A limit that is negative or no number is refused by its name and deletes nothing."""
    with storage.open_database(url) as database:
        database.record_cycle(*make_cycle(1))
        with pytest.raises(InputError, match="keep_mb"):
            database.trim(size)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 32 MB of its own."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=32m", "none", str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    if mount.returncode != 0:
        pytest.skip(f"no file system can be mounted here: {mount.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.long
@pytest.mark.attack
@pytest.mark.slow
@pytest.mark.parametrize("beside", [False, True], ids=["stopped", "running"])
def test_prune_on_a_full_disk(small_disk, make_cycle, capsys, figure, beside):
    """The command of the runbook exits 0 on a full disk and frees half of the file."""
    url = f"sqlite:///{small_disk}/slipstream.db"
    report, plans, states = _city(make_cycle(1), 30)
    cycle = (report.model_copy(update={"reason": "x" * 100_000}), plans, states)
    start_ns = time.time_ns() - DAY_NS
    dispatcher = storage.open_database(url, owned=True)
    number = 0
    # A dispatcher that stops has room to empty its log, so that a start needs some for a new one.
    room = 0 if beside else 6 * 2**20
    with suppress(storage.StorageError):
        while os.statvfs(small_disk).f_bavail * 4096 >= room and number < 1000:
            dispatcher.record_cycle(*_at(cycle, number + 1, start_ns + number * 10**9))
            number += 1
    if not beside:
        dispatcher.close()
    with suppress(OSError), (small_disk / "other.log").open("wb", buffering=0) as other:
        while other.tell() < 2**26:
            other.write(bytes(512))
    assert os.statvfs(small_disk).f_bavail == 0
    if not beside:
        # Nobody's bad input: systemd has to try again.
        with pytest.raises(storage.StorageError, match="room on the disk"):
            storage.open_database(url, owned=True)
    before = _path(url).stat().st_size
    # So that somewhat less than half of the cycles stay, by age or by size.
    if beside:
        keep_mb = (before / 2 + retention.LOG_BYTES + retention.RESERVE_BYTES) / 1e6
        limit = ["--keep-mb", str(keep_mb)]
    else:
        limit = ["--keep-days", str((time.time_ns() - start_ns - number * 55 * 10**7) / DAY_NS)]
    assert main(["db", "prune", "--url", url, *limit]) == 0
    after = _path(url).stat().st_size
    assert after <= before / 2
    assert retention.reserve_path(_path(url)).stat().st_size == retention.RESERVE_BYTES
    stored = _stored(url)
    assert stored == list(range(stored[0], number + 1))
    assert number * 0.3 < len(stored) < number * 0.6
    if not beside:
        dispatcher = storage.open_database(url, owned=True)
    dispatcher.record_cycle(*_at(cycle, number + 1, number + 1))
    dispatcher.close()
    assert storage.check(url).ok
    figure(f"{before / 1e6:.1f} MB on a full disk became {after / 1e6:.1f} MB")


def test_a_reserve_that_has_no_room_is_left_out(small_disk, make_cycle, caplog):
    """A start with little room says so and goes on."""
    url = f"sqlite:///{small_disk}/slipstream.db"
    (small_disk / "other.log").write_bytes(bytes(26 * 2**20))
    with storage.open_database(url, owned=True) as database:
        database.record_cycle(*make_cycle(1))
    assert "no room for its reserve file" in caplog.text
    assert not retention.reserve_path(_path(url)).exists()
